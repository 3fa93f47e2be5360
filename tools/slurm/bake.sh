#!/usr/bin/env bash
# Bakes a level on a Slurm cluster: solve, an array of shards, merge.
#
#   tools/slurm/bake.sh SCENE OUT SHARDS [OPTIONS OF `lumel solve`…]
#
# SCENE, OUT and the work folder must be in a folder that all nodes share. Prints the ID of the last
# job. Logs go to the work folder. A shard is queued again if its node fails, and tried again up to
# RETRIES times if it fails by itself; a shard that already exists takes a second.
#
# Environment: LUMEL (the program; default `lumel`), WORK (default OUT.work), SBATCH_ARGS (for all
# jobs, e.g. "--partition=farm --time=2:00:00"), CPUS (per job; default 4), RETRIES (default 3).
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,12s/^# \{0,1\}//p' "$0" >&2; exit 1; }
scene=$(realpath "$1") out=$(realpath -m "$2") shards=$3
shift 3
work=$(realpath -m "${WORK:-$out.work}")
lumel=${LUMEL:-lumel} cpus=${CPUS:-4} retries=${RETRIES:-3}
mkdir -p "$work"
read -ra more <<<"${SBATCH_ARGS:-}"

submit() { # NAME [OPTIONS…] -- COMMAND…
    local name=$1 options=()
    shift
    while [ "$1" != -- ]; do options+=("$1"); shift; done
    shift
    # --requeue restarts a job whose node fails. The loop repeats a failed command on the same node.
    sbatch --parsable --requeue --job-name="lumel-$name" --chdir="$work" \
        --output="$work/$name-%A-%a.log" --open-mode=append --cpus-per-task="$cpus" \
        "${more[@]}" "${options[@]}" <<JOB
#!/usr/bin/env bash
for try in \$(seq $((retries + 1))); do
    $(printf '%q ' "$@") --threads "\$SLURM_CPUS_PER_TASK" && exit 0
    code=\$?
    # Code 2 is an I/O error, e.g. an unmounted folder, and 75 a stopped bake. Retrying does not help
    # against other errors, except a kill (over 128).
    [ \$code = 2 ] || [ \$code = 75 ] || [ \$code -gt 128 ] || exit \$code
    sleep \$((10 * try))
done
exit \$code
JOB
}

solve=$(submit solve -- "$lumel" solve "$scene" -o "$work" "$@" -q)
# The inner bash expands the array's task ID on the node.
gather=$(submit gather --dependency="afterok:$solve" --kill-on-invalid-dep=yes \
    --array="1-$shards" -- env LUMEL_SHARDS="$shards" LUMEL_WORK="$work" LUMEL_PROGRAM="$lumel" \
    bash -c 'exec "$LUMEL_PROGRAM" gather "$LUMEL_WORK" --shard "$SLURM_ARRAY_TASK_ID/$LUMEL_SHARDS" -q "$@"' gather)
merge=$(submit merge --dependency="afterok:$gather" --kill-on-invalid-dep=yes \
    -- "$lumel" merge "$work" -o "$out" -q)
echo "$merge"
