#!/usr/bin/env bash
# Installs the lowest version of everything that pyproject.toml allows, in an environment of its own, and runs a telling part of
# the tests there. Takes some minutes; `make lowest` calls it.
#
#     tests/lowest_versions.sh [FOLDER of the environment]
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-.venv-lowest}
"${PYTHON:-python3}" -m venv --clear "$folder"
"$folder/bin/python" tests/lowest_versions.py viewer sweep test > "$folder/lowest.txt"
"$folder/bin/pip" install -q --disable-pip-version-check -c "$folder/lowest.txt" -e '.[test]'
"$folder/bin/pip" freeze | sort > "$folder/installed.txt"
# each names what it is for: casadi (rollouts, sweeps, export), scipy (tune), xarray and zarr (stores), typer (command line),
# pyzmq and tornado (viewer), lxml and yourdfpy (descriptions), jinja2 and matplotlib (figures, export)
"$folder/bin/pytest" -n "${JOBS:-2}" \
  tests/compiled/test_store.py tests/compiled/test_sweep.py tests/compiled/test_tune.py tests/compiled/test_kept.py \
  tests/compiled/test_batch.py tests/compiled/test_program.py tests/view/test_live.py tests/view/test_pages.py \
  tests/description tests/arm/test_load.py tests/arm/test_inverse.py tests/paths/test_joint_plan.py tests/test_cli.py \
  tests/report/test_cases.py tests/simulation/test_simulate.py
"$folder/bin/pytest" -n "${JOBS:-2}" tests/compiled/test_export.py -k "compiles or selftest or agree or arm"
