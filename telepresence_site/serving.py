"""The command line of daphne."""

# A lost page is noticed within seconds, not a minute, and messages are as large as a page may send.
# The access log, which would contain one-time links, is off; see web/request_log.py.
DAPHNE = (
    *("-m", "daphne", "-v", "0"),
    *("--ping-interval", "5", "--ping-timeout", "10"),
    *("--websocket-max-message-size", "131072"),
)
APPLICATION = "telepresence_site.asgi:application"
