"""`manage.py demo`: the whole system on one machine, with nothing to set up."""
