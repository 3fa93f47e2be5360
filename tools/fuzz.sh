#!/bin/sh
# Feeds damaged inputs of every kind to the targets of crates/lumel/tests/fuzz for MINUTES in total, one process per target:
#
#     tools/fuzz.sh MINUTES [SEED] [TARGET…]
#
# Prints one line per target. Failing inputs go to the folder `fuzz` in Cargo's target/tmp, and the script then exits with 1.
# SEED defaults to the time, so every run differs. LUMEL_FUZZ_SEEDS may name a folder with more .glb files to damage.
# LUMEL_FUZZ_BAKED may name a folder for the inputs and outputs of `bakes`, which
# `validate.mjs --pairs` compares.
set -u
[ $# -ge 1 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 1; }
minutes=$1
seed=${2:-$(date +%s)}
[ $# -ge 2 ] && shift
shift
targets=${*:-containers documents meshopt cached_charts pictures lamps maps skies lists_of_points files_of_settings manifests_and_reports requests bakes}
cd "$(dirname "$0")/.." || exit 2
cargo test --release -p lumel --test all --no-run || exit 2
# A process that allocates too much memory is killed, and its test fails.
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
    # Panic messages; the failing inputs are named after them.
    grep -A1 'panicked at' "$log" | head -20
    rm -f "$log"
done
exit $wrong
