#!/bin/sh
# Damages inputs of every kind for MINUTES, divided among the targets of crates/lumel/tests/fuzz, each in a process of its own:
#
#     tools/fuzz.sh MINUTES [SEED] [TARGET…]
#
# A line a target says what was done. What goes wrong lies in the folder `fuzz` of Cargo's target/tmp, and the script ends with 1.
# SEED defaults to the time, so that every run is another one; LUMEL_FUZZ_SEEDS may name a folder with further .glb to damage.
set -u
[ $# -ge 1 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 1; }
minutes=$1
seed=${2:-$(date +%s)}
[ $# -ge 2 ] && shift
shift
targets=${*:-containers documents pictures lamps maps skies lists_of_points files_of_settings manifests_and_reports requests bakes}
cd "$(dirname "$0")/.." || exit 2
cargo test --release -p lumel --test all --no-run || exit 2
# Memory that runs away ends the process, and the test with it.
ulimit -v 8388608
count=$(echo "$targets" | wc -w)
LUMEL_FUZZ_SECONDS=$(awk "BEGIN { print 60 * $minutes / $count }")
LUMEL_FUZZ_SEED=$seed
export LUMEL_FUZZ_SECONDS LUMEL_FUZZ_SEED
echo "seed $seed, $LUMEL_FUZZ_SECONDS s a target"
wrong=0
for target in $targets; do
    log=$(mktemp)
    cargo test --release -q -p lumel --test all -- --exact --nocapture "fuzz::$target" >"$log" 2>&1 || wrong=1
    grep ' executions, ' "$log" || { echo "$target ended before its time:"; tail -20 "$log"; }
    # Messages of panics: the inputs that led to them are named after them.
    grep -A1 'panicked at' "$log" | head -20
    rm -f "$log"
done
exit $wrong
