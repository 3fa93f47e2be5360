#!/usr/bin/env bash
# Bakes a level on a Slurm cluster: solve, an array of shards, merge.
#
#   tools/slurm/bake.sh SCENE OUT SHARDS [OPTIONS OF `lumel solve`…]
#
# SCENE, OUT and the work folder lie in a folder that all nodes share. Prints the number of the last
# job; `sbatch` leaves logs in the work folder. A shard whose node fails is queued again, up to
# RETRIES times if it fails by itself; one that is there already takes a second.
#
# Environment: LUMEL (the program; default `lumel`), WORK (default OUT.work), SBATCH_ARGS (for all
# jobs, e.g. "--partition=farm --time=2:00:00"), CPUS (a shard's; default 4), RETRIES (default 3).
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,12s/^# \{0,1\}//p' "$0" >&2; exit 1; }
scene=$(realpath "$1") out=$(realpath -m "$2") shards=$3
shift 3
work=$(realpath -m "${WORK:-$out.work}")
lumel=${LUMEL:-lumel} cpus=${CPUS:-4} retries=${RETRIES:-3}
mkdir -p "$work"
read -ra more <<<"${SBATCH_ARGS:-}"

submit() { # NAME, options and the command after --
    local name=$1 options=()
    shift
    while [ "$1" != -- ]; do options+=("$1"); shift; done
    shift
    # --requeue: a job whose node fails starts again. A failed step is tried again in place.
    sbatch --parsable --requeue --job-name="lumel-$name" --chdir="$work" \
        --output="$work/$name-%A-%a.log" --open-mode=append --cpus-per-task="$cpus" \
        "${more[@]}" "${options[@]}" <<JOB
#!/usr/bin/env bash
for try in \$(seq $((retries + 1))); do
    $(printf '%q ' "$@") --threads "\$SLURM_CPUS_PER_TASK" && exit 0
    code=\$?
    # 2: input or output, e.g. a shared folder that is away. 75: stopped. Others come again.
    [ \$code = 2 ] || [ \$code = 75 ] || [ \$code -gt 128 ] || exit \$code
    sleep \$((10 * try))
done
exit \$code
JOB
}

solve=$(submit solve -- "$lumel" solve "$scene" -o "$work" "$@" -q)
# %q keeps the array's number for the node to fill in.
gather=$(submit gather --dependency="afterok:$solve" --kill-on-invalid-dep=yes \
    --array="1-$shards" -- env LUMEL_SHARDS="$shards" LUMEL_WORK="$work" LUMEL_PROGRAM="$lumel" \
    bash -c 'exec "$LUMEL_PROGRAM" gather "$LUMEL_WORK" --shard "$SLURM_ARRAY_TASK_ID/$LUMEL_SHARDS" -q "$@"' gather)
merge=$(submit merge --dependency="afterok:$gather" --kill-on-invalid-dep=yes \
    -- "$lumel" merge "$work" -o "$out" -q)
echo "$merge"
