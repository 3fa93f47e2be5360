#!/bin/sh
# Publishes the crates to crates.io, in the order of their dependencies. Rehearses unless told --really.
#
# Usage: tools/publish.sh [--really | --allow-dirty …]
# cargo packs all crates, builds each from its package against the others' packages, and uploads none.
set -eu
cd "$(dirname "$0")/.."
if [ "${1:-}" = --really ]; then
    shift
else
    set -- --dry-run "$@"
fi
exec cargo publish --locked "$@" \
    -p lumel-visibility -p lumel-mesh-ingest -p lumel-patch-subdivision \
    -p lumel-radiosity -p lumel-atlas -p lumel-gather -p lumel-atlas-bake -p lumel
