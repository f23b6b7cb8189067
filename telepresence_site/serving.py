"""How daphne is started, wherever it is started."""

# A page that vanished is noticed in seconds, not in a minute; and no more is read of a message than
# a page may send. Without its access log, which would have one-time links in it:
# telepresence_site/web/request_log.py says what was asked.
DAPHNE = (
    "-m",
    "daphne",
    "-v",
    "0",
    "--ping-interval",
    "5",
    "--ping-timeout",
    "10",
    "--websocket-max-message-size",
    "131072",
)
APPLICATION = "telepresence_site.asgi:application"
