"""Configuration files of a team's tunnel (OpenVPN), and the script that opens it."""

from __future__ import annotations

TUNNEL = """\
# The tunnel of a team, for OpenVPN 2.6. Started by `sudo team up`, in this folder.
dev mrs0
dev-type tun
topology subnet
ca ca.pem
cert cert.pem
key key.pem
tls-version-min 1.3
cipher AES-256-GCM
disable-dco
verb 1
persist-key
persist-tun
# `team attach` puts the tunnel's interface into a network namespace of its own.
script-security 2
up "./team attach"
ifconfig-noexec
route-noexec
# What waits longer than this is dropped: a late scan is of no use.
tcp-queue-limit 64
socket-flags TCP_NODELAY
"""
PLANNER_TUNNEL = """\
proto tcp-server
port {port}
server 10.99.0.0 255.255.255.0
# Everybody keeps their address, over restarts, too: DDS would take them for somebody new.
ifconfig-pool-persist addresses 5
# Robots and laptops of the team reach each other, too.
client-to-client
dh none
# It accepts hosts with a certificate of this team, made for a robot and not revoked.
remote-cert-tls client
crl-verify crl.pem
# Everybody shows it again so often [s]; a revoked host can stay so long.
reneg-sec {recheck_s}
# A robot that hears nothing for 4 s connects again.
keepalive 1 4
"""
ROBOT_TUNNEL = """\
client
proto tcp-client
remote {address} {port}
nobind
# It talks to the host with a certificate of this team that was made for the planner.
remote-cert-tls server
verify-x509-name planner name
reneg-sec 0
connect-timeout 3
connect-retry 1 1
"""
#: Where a host's folder goes: the tunnel is root's, and so is what it runs.
ROOTS_FOLDER = "/etc/mrs_team"
#: How often everybody shows their certificate again [s].
RECHECK_S = 60
TEAM_SCRIPT = """\
#!/bin/sh
# sudo team up        opens the tunnel of the team on this host; Ctrl-C or SIGTERM closes it.
# team run COMMAND    runs a command as you, where the tunnel is the only network.
netns=mrs
case $1 in
up)
    cd -P "$(dirname "$0")" || exit
    # Root runs what lies here: nobody else may write to it, or put something else in its place.
    others=$(find . ! -user root -o ! -type l -perm /022)
    at=$PWD
    until [ "$at" = / ]; do
        at=$(dirname "$at")
        others="$others $(find "$at" -prune \\( ! -user root -o -perm /022 ! -perm -1000 \\))"
    done
    if [ "$(echo $others)" ]; then
        echo "error: root would run what others may write:" $others >&2
        echo "Make $PWD root's, in a folder of root's, and run it there:" >&2
        echo "    sudo mv $PWD @ROOT@" >&2
        echo "    sudo chown -R root:root @ROOT@" >&2
        echo "    sudo chmod -R go-w @ROOT@ && sudo chmod 755 @ROOT@" >&2
        exit 1
    fi
    [ -e "/run/netns/$netns" ] || ip netns add "$netns" || exit
    ip -n "$netns" link set lo up || exit
    exec openvpn --config tunnel.conf
    ;;
attach) # called by openvpn: attach DEVICE MTU 0 ADDRESS MASK ...
    ip link set dev "$2" netns "$netns" || exit
    ip -n "$netns" address add "$5/24" dev "$2" || exit
    ip -n "$netns" link set dev "$2" mtu "$3" multicast on up || exit
    ip -n "$netns" route replace default dev "$2"
    ;;
run)
    shift
    if ! [ -e "/run/netns/$netns" ]; then
        echo "error: there is no tunnel; open it with: sudo @ROOT@/team up" >&2
        exit 1
    fi
    [ "$(id -u)" -ne 0 ] || exec ip netns exec "$netns" "$@"
    # sudo changes these even with -E, and ROS lives by them.
    exec sudo -E ip netns exec "$netns" \\
        setpriv --reuid "$(id -u)" --regid "$(id -g)" --init-groups \\
        env "HOME=$HOME" "PATH=$PATH" \\
        ${LD_LIBRARY_PATH:+"LD_LIBRARY_PATH=$LD_LIBRARY_PATH"} \\
        ${PYTHONPATH:+"PYTHONPATH=$PYTHONPATH"} \\
        "$@"
    ;;
*)
    sed -n '2,3s/# //p' "$0" >&2
    exit 2
    ;;
esac
""".replace("@ROOT@", ROOTS_FOLDER)
