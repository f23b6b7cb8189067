"""To leave a study with everything: what is deleted, what stays, and the receipt."""
