"""What a site needs to serve visitors, checked now, for a page of the administrator and for
`manage.py doctor`.
"""
