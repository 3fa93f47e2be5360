#!/bin/sh
# Publishes the crates to crates.io in dependency order. Without --really it is a dry run.
#
# Usage: tools/publish.sh [--really | --allow-dirty …]
# A dry run packages all crates and builds each against the other packages.
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
