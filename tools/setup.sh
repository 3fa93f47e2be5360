#!/bin/sh
# Prepares the measuring environment on a new Debian machine: LLVM for Mitsuba, a Python environment, the Khronos validator, two web engines.
#
# Usage: tools/setup.sh [VENV [NPM_DIR]]      (or LUMEL_VENV, LUMEL_NPM; defaults /opt/lumel-venv, /opt/lumel-npm)
# Needs Python 3.11, npm, and root for apt-get (skipped if libLLVM 19 is installed or apt-get is not). About 1.6 GB, three minutes.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv=${1:-${LUMEL_VENV:-/opt/lumel-venv}}
npm_dir=${2:-${LUMEL_NPM:-/opt/lumel-npm}}

if ! ls /usr/lib/*/libLLVM*19* >/dev/null 2>&1; then
    if command -v apt-get >/dev/null; then
        apt-get update -qq
        apt-get install -y -qq --no-install-recommends libllvm19
    else
        echo "install LLVM 19's shared library and set DRJIT_LIBLLVM_PATH" >&2
    fi
fi
python=$(command -v python3.11 || command -v python3)
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/pip" install -q -r "$here/requirements.txt"
mkdir -p "$npm_dir"
(cd "$npm_dir" && npm install --silent --no-fund --no-audit gltf-validator@2.0.0-dev.3.10 playcanvas@2.23.3 babylonjs@9.28.0 babylonjs-loaders@9.28.0 fflate@0.8.3 \
    three@0.187 react@~19.3 react-dom@~19.3 @react-three/fiber@9.8 esbuild@0.28 typescript@7 @types/three@0.187 @types/react@19)

"$venv/bin/python" -c 'import bpy, mitsuba, numpy; print("bpy", bpy.app.version_string, "mitsuba", mitsuba.__version__)'
"$venv/bin/python" "$here/truth_check.py"
LUMEL_NPM=$npm_dir node "$here/validate.mjs" "$here/../assets"
