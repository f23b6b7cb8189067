#!/bin/sh
# The proxy's certificate for those that need it, too: copy_certificates.sh HOST, daily by telepresence-certificates@HOST.timer.
# Each has a folder, whose group may read what is put there; a folder that does not exist is passed over. Only who gets something new is told.
set -eu
host=$1
root=${ROOT:-} # for the tests
# Caddy's own, or with nginx certbot's; the newest, because Caddy has a folder for each authority.
chain=$(ls -t "$root"/var/lib/caddy/.local/share/caddy/certificates/*/"$host/$host.crt" "$root/etc/letsencrypt/live/$host/fullchain.pem" 2>/dev/null | head -n 1)
case "$chain" in
    "") echo "There is no certificate of $host yet: the proxy fetches one when it is up and the name points at this machine." >&2; exit 1 ;;
    *.crt) key=${chain%.crt}.key ;;
    *) key=${chain%fullchain.pem}privkey.pem ;;
esac
is_new() {
    [ -d "$root$1" ] && ! { cmp -s "$chain" "$root$1/fullchain.pem" && cmp -s "$key" "$root$1/privkey.pem"; }
}
put() {
    install -m 0640 "$key" "$root$1/privkey.pem"
    install -m 0644 "$chain" "$root$1/fullchain.pem"
    echo "The certificate of $host is in $1."
}
if is_new /etc/mosquitto/certs; then
    put /etc/mosquitto/certs
    systemctl try-reload-or-restart mosquitto
fi
if is_new /etc/coturn/certs; then
    put /etc/coturn/certs
    if systemctl is-active --quiet coturn; then systemctl kill --signal=SIGUSR2 coturn; fi
fi
# Of our own broker, where it runs in Mosquitto's place: it reads its certificate when it starts.
if is_new /etc/telepresence/certs; then
    put /etc/telepresence/certs
    systemctl try-restart telepresence-broker
fi
