#!/usr/bin/env bash
# Runs the form-factor half of the laboratory and draws its pictures: lab/laboratory/form_factors.{csv,md,png,svg} and
# form_factors_irradiance.{png,svg}, convergence.{csv,md,png,svg} beside them.  Python with matplotlib is $PY (default python3).  Nothing else should run meanwhile.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --locked -p lumel-lab
out=lab/laboratory
mkdir -p "$out"
"${CARGO_TARGET_DIR:-target}/release/lumel-lab" form-factors --out "$out" >"$out/form_factors.md"
"${PY:-python3}" tools/plot_lab.py form-factors "$out/form_factors.csv" "$out/form_factors"
"${CARGO_TARGET_DIR:-target}/release/lumel-lab" convergence --out "$out" >"$out/convergence.md"
"${PY:-python3}" tools/plot_lab.py convergence "$out/convergence.csv" "$out/convergence"
