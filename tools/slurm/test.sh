#!/usr/bin/env bash
# Bakes the demo level with tools/slurm/bake.sh on a Slurm cluster of three nodes on this machine,
# kills one of them in the middle, and compares the results with those of `lumel bake`.
#
#   tools/slurm/test.sh [LUMEL]      default: target/release/lumel
#
# Needs root and Debian's packages slurmctld, slurmd, slurm-client and munge, which it installs if
# they are missing. Everything else is in a temporary folder, and every daemon ends with the script.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd) root=$(cd "$(dirname "$0")/../.." && pwd)
lumel=$(realpath "${1:-$root/target/release/lumel}")
fail() { echo "slurm test: $*" >&2; exit 1; }
[ "$(id -u)" = 0 ] || fail "NOT RUN: it needs root, to install and start Slurm"
[ -x "$lumel" ] || fail "NOT RUN: found no program at $lumel, expected lumel; build it first"
if ! command -v slurmctld slurmd munged sbatch >/dev/null; then
    echo "installing slurmctld, slurmd, slurm-client, munge"
    # Installation must not start services; this script does.
    printf '#!/bin/sh\nexit 101\n' >/usr/sbin/policy-rc.d.lumel
    [ -e /usr/sbin/policy-rc.d ] || { cp /usr/sbin/policy-rc.d.lumel /usr/sbin/policy-rc.d; own=1; }
    chmod +x /usr/sbin/policy-rc.d
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -yqq \
        slurmctld slurmd slurm-client munge; } >/tmp/lumel-slurm-install.log 2>&1 ||
        fail "NOT RUN: Slurm cannot be installed, see /tmp/lumel-slurm-install.log"
    rm -f /usr/sbin/policy-rc.d.lumel
    [ -z "${own:-}" ] || rm -f /usr/sbin/policy-rc.d
fi

t=$(mktemp -d /tmp/lumel-slurm-XXXX)
chmod 755 "$t"
started=()
below() { # these processes and their descendants
    local pid
    for pid in "$@"; do
        # shellcheck disable=SC2046
        below $(ps -o pid= --ppid "$pid" || true)
        echo "$pid"
    done
}
finish() {
    code=$?
    timeout 10 scancel --user=root 2>/dev/null || true
    # shellcheck disable=SC2046
    for pid in "${started[@]}"; do kill -9 $(below "$pid") 2>/dev/null || true; done
    [ $code = 0 ] && rm -rf "$t" || echo "slurm test: failed; see $t" >&2
}
trap finish EXIT

mkdir -p "$t"/{munge,state,spool,log}
dd if=/dev/urandom of="$t/munge/key" bs=1024 count=1 status=none
chmod 700 "$t/munge"; chmod 400 "$t/munge/key"
munged --force --foreground --key-file="$t/munge/key" --socket="$t/munge.socket" \
    --pid-file="$t/munge/pid" --log-file="$t/munge/log" --seed-file="$t/munge/seed" \
    2>"$t/log/munged" &
started+=($!); disown
host=$(hostname -s)
cat >"$t/slurm.conf" <<CONF
ClusterName=lumel
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$t/munge.socket
CredType=cred/munge
StateSaveLocation=$t/state
SlurmdSpoolDir=$t/spool/%n
SlurmctldPidFile=$t/slurmctld.pid
SlurmdPidFile=$t/slurmd-%n.pid
SlurmctldLogFile=$t/log/slurmctld
SlurmdLogFile=$t/log/slurmd-%n
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=2,bf_interval=2
SlurmdParameters=config_overrides
SlurmdTimeout=10
SlurmctldTimeout=60
MinJobAge=3600
ReturnToService=2
MpiDefault=none
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=27001 CPUs=1 RealMemory=1000
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=27002 CPUs=1 RealMemory=1000
NodeName=n3 NodeHostname=$host NodeAddr=127.0.0.1 Port=27003 CPUs=1 RealMemory=1000
PartitionName=all Nodes=n[1-3] Default=YES MaxTime=1:00:00 State=UP
CONF
export SLURM_CONF=$t/slurm.conf
sleep 1
slurmctld -D -f "$SLURM_CONF" >/dev/null 2>"$t/log/ctld" &
started+=($!); disown
declare -A node
for n in n1 n2 n3; do
    mkdir -p "$t/spool/$n"
    slurmd -D -N "$n" -f "$SLURM_CONF" >/dev/null 2>"$t/log/$n" &
    node[$n]=$!
    started+=($!); disown
done
for _ in $(seq 60); do
    [ "$(sinfo -h -N -t idle -o %N 2>/dev/null | wc -l)" = 3 ] && break
    sleep 1
done
[ "$(sinfo -h -N -t idle -o %N | wc -l)" = 3 ] || fail "the nodes do not come up: $(sinfo -N 2>&1)"
echo "three nodes of Slurm $(slurmctld -V | cut -d' ' -f2) on $host"

scene=$t/level.glb
cp "$root/assets/demo_level.glb" "$scene"
options=(--quality quick --texels-per-unit "${DENSITY:-10}" --sky 0.25,0.35,0.5)
"$lumel" bake "$scene" -o "$t/plain" "${options[@]}" -q

merge=$(CPUS=1 LUMEL=$lumel "$here/bake.sh" "$scene" "$t/farm" 8 "${options[@]}")
work=$t/farm.work
killed=""
begin=$SECONDS
while [ ! -e "$t/farm/level.report.json" ]; do
    # Kills a node while it gathers: the daemon, and the job with it.
    if [ -z "$killed" ]; then
        busy=$(squeue -h -t running -n lumel-gather -o '%N %i' | head -1)
        if [ -n "$busy" ]; then
            sleep 1
            killed=${busy%% *} job=${busy#* }
            # The step's process is no longer a child of the daemon.
            steps=$(pgrep -f "slurmstepd: \[${job%%_*}" || true)
            on=""
            for s in $steps; do
                grep -qz "SLURMD_NODENAME=$killed" "/proc/$(pgrep -P "$s" | head -1)/environ" \
                    2>/dev/null && on="$on $s"
            done
            # shellcheck disable=SC2046,SC2086
            kill -9 ${node[$killed]} $(below $on) 2>/dev/null || true
            echo "killed node $killed with job $job after $(ls "$work" | grep -c light || true) shards"
        fi
    fi
    [ $((SECONDS - begin)) -lt 600 ] || fail "no result after ten minutes: $(squeue 2>&1)"
    state=$(squeue -h -j "$merge" -o %T 2>/dev/null || true)
    [ -n "$state" ] || [ -e "$t/farm/level.report.json" ] || { sleep 2
        [ -e "$t/farm/level.report.json" ] || fail "the merge is gone: $(cat "$work"/*.log)"; }
    sleep 0.2
done
[ -n "$killed" ] || fail "no node was killed: the shards were too quick; raise DENSITY"
sleep 1
sed -n 's/.*\(requeue.*\)/slurmctld: \1/Ip' "$t/log/slurmctld" | sort | uniq -c | head -5
for file in "$t"/plain/*; do
    name=$(basename "$file")
    case $name in
        # Times differ.
        *.report.json) python3 - "$file" "$t/farm/$name" <<'PY' || fail "$name differs"
import json, sys
a, b = (json.load(open(f)) for f in sys.argv[1:])
a.pop("measured"), b.pop("measured")
sys.exit(a != b)
PY
        ;;
        *) cmp "$file" "$t/farm/$name" || fail "$name differs" ;;
    esac
done
echo "slurm test: 8 shards on 3 nodes, node $killed killed, $((SECONDS - begin)) s: the results are equal"
