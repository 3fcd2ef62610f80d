#!/usr/bin/env bash
# Trains with two workers on two "hosts": network namespaces of their own, joined by a virtual cable.
#   tests/system/two_hosts.sh PROGRAM CONFIG FOLDER
# Exit code 77 with a reason where namespaces may not be made (they need root).
set -euo pipefail
program="$1" config="$2" folder="$3"
# Names that no other run has; the namespaces go away with the script.
one="malus$$a" two="malus$$b"
skip() { echo "skipped: $1" >&2; exit 77; }
command -v ip >/dev/null || skip "no ip command (iproute2)"
cleanup() {
  ip netns delete "$one" 2>/dev/null || true
  ip netns delete "$two" 2>/dev/null || true
}
trap cleanup EXIT
ip netns add "$one" 2>/dev/null && ip netns add "$two" 2>/dev/null || skip "network namespaces are not allowed here"
ip link add "v$one" netns "$one" type veth peer name "v$two" netns "$two" 2>/dev/null \
  || skip "virtual network cables are not allowed here"
ip -n "$one" address add 10.77.0.1/24 dev "v$one"
ip -n "$two" address add 10.77.0.2/24 dev "v$two"
for host in "$one" "$two"; do
  ip -n "$host" link set lo up
  ip -n "$host" link set "v$host" up
done
worker() {  # HOST RANK
  ip netns exec "$1" env RANK="$2" WORLD_SIZE=2 MASTER_ADDR=10.77.0.1 MASTER_PORT=29500 \
    GLOO_SOCKET_IFNAME="v$1" "$program" train "$config" -o "$folder" --threads 1 -q
}
worker "$two" 1 &
other=$!
worker "$one" 0
wait "$other"
