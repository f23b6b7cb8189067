#!/bin/sh
# A real ROS 2 for the tests, in an environment of its own: set_up_ros2.sh PYTHON VENV. Wheels have
# rclpy; the messages of Nav2, which have none, are built here from tests/support/architectures.
set -eu
venv="$2"
source=tests/support/architectures/nav2_msgs
sh deploy/set_up.sh "$1" "$venv" requirements-ros2.lock
# a stamp of what was built: the definitions, and the environment that they were built in
stamp=$(cat "$venv/installed" $(find "$source" -type f | sort) | sha256sum)
[ "$(cat "$venv/nav2_msgs" 2>/dev/null)" = "$stamp" ] && exit 0
started=$(date +%s)
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
prefix=$(cd "$venv" && pwd)
export PATH="$prefix/bin:$PATH" AMENT_PREFIX_PATH="$prefix" CMAKE_PREFIX_PATH="$prefix"
# CMake reports folders of the computer that the wheels were built on, and goes on without them.
cmake -S "$source" -B "$build" -G "Unix Makefiles" -DCMAKE_INSTALL_PREFIX="$prefix" \
    -DPython3_EXECUTABLE="$prefix/bin/python" -DBUILD_TESTING=OFF -Wno-dev >"$build/log" 2>&1 || true
if ! { cmake --build "$build" -j 2 && cmake --install "$build"; } >>"$build/log" 2>&1 \
    || ! "$prefix/bin/python" -c "from nav2_msgs.action import NavigateToPose" 2>>"$build/log"; then
    tail -n 20 "$build/log" >&2
    echo "The messages of Nav2 could not be built: is a C++ compiler installed?" >&2
    exit 1
fi
echo "$stamp" >"$venv/nav2_msgs"
echo "  messages of Nav2 for ROS 2: $(($(date +%s) - started)) s"
