#!/bin/sh
# Bakes three levels on several processors, which qemu imitates, and compares the bytes of what is
# written:
#
#     tools/same_bytes.sh [QUALITY [TEXELS_PER_UNIT]]
#
# Needs a release build and qemu-x86_64 (Debian: qemu-user). Prints a Markdown table of hashes and
# ends with 1 if a processor gives others. LUMEL_TARGET names another folder than `target`. BUILDS
# lists more builds for this processor, e.g. "x86-64-v3=PATH x86-64-v4=PATH", and ARM is one for
# aarch64, which qemu-aarch64 runs. CPUS lists the processors that qemu imitates.
set -eu
cd "$(dirname "$0")/.."
quality=${1:-draft}
density=${2:-8}
build=${LUMEL_TARGET:-${CARGO_TARGET_DIR:-target}}/release
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# The cave's rock is unwrapped in large curved charts, which need a solver.
for family in cave; do
    "$build/make-level" "$family" 1 -o "$scratch" --small >/dev/null
done
levels="assets/cornell_box.glb assets/classic_room_1014.glb $(find "$scratch" -name '*.glb' | sort)"

bake() { # NAME COMMAND…
    name=$1
    shift
    row="| $name |"
    for level in $levels; do
        out=$scratch/out
        rm -rf "$out"
        # qemu warns of every feature that it cannot imitate.
        "$@" bake "$level" -o "$out" --quality "$quality" --texels-per-unit "$density" --no-config -q \
            >/dev/null 2>"$scratch/said" || { cat "$scratch/said" >&2; exit 2; }
        # Reports hold times.
        hash=$(cd "$out" && find . -type f ! -name '*report*' | sort | xargs cat | sha256sum | cut -c1-12)
        row="$row \`$hash\` |"
    done
    echo "$row"
    echo "${row#*|*|}" >>"$scratch/hashes"
}

printf '| processor |'
for level in $levels; do printf ' %s |' "$(basename "$level" .glb)"; done
printf '\n|---|---|---|---|\n'
bake "this one" "$build/lumel"
bake "this one, LUMEL_KERNEL=portable" env LUMEL_KERNEL=portable "$build/lumel"
for named in ${BUILDS:-}; do
    bake "this one, built for ${named%%=*}" "${named#*=}"
done
for cpu in ${CPUS-Nehalem Haswell max max,-fma}; do
    bake "qemu $cpu" qemu-x86_64 -cpu "$cpu" "$build/lumel"
done
[ -z "${ARM:-}" ] || bake "qemu aarch64" qemu-aarch64 "$ARM"
[ "$(sort -u "$scratch/hashes" | wc -l)" = 1 ]
