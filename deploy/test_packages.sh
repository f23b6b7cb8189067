#!/bin/sh
# The Debian packages that the tests drive for real. As root they are installed; otherwise the exact line is named.
set -eu
packages="chromium-headless-shell firefox-esr systemd openssl mosquitto postgresql patroni etcd-server redis-server nginx-light caddy coturn janus iproute2 nftables nodejs npm fonts-dejavu-core"
# Real sound servers for microphone and loudspeaker, and a real RTSP server for cameras: 67 MB to download.
packages="$packages alsa-utils libasound2-plugins pulseaudio pulseaudio-utils pipewire pipewire-pulse wireplumber dbus-daemon"
packages="$packages python3-gi gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly"
# A real ROS 1 for its adapter: 11 MB to download.
packages="$packages python3-rospy python3-rosmaster python3-nav-msgs python3-sensor-msgs python3-std-srvs python3-move-base-msgs python3-actionlib"
# A bare Debian, on which the wheel is installed.
packages="$packages mmdebstrap"
# What builds messages of ROS 2 for the tests (set_up_ros2.sh).
packages="$packages cmake make g++"
missing=""
for package in $packages; do
    case "$package" in
        nodejs) command -v node >/dev/null 2>&1 && continue ;;
        npm) command -v npm >/dev/null 2>&1 && continue ;;
    esac
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q "ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
if [ "$(id -u)" -ne 0 ]; then
    echo "The tests need more Debian packages: sudo apt-get install --no-install-recommends$missing" >&2
    exit 1
fi
started=$(date +%s)
echo "  installing Debian packages:$missing"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
# A fresh server's own start-up scripts must not start brokers and databases: the tests start theirs.
trap 'rm -f "$log"' EXIT
if ! { apt-get update && apt-get install -y --no-install-recommends $missing; } >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    echo "The Debian packages could not be installed: apt-get install --no-install-recommends$missing" >&2
    exit 1
fi
echo "  Debian packages: $(($(date +%s) - started)) s"
