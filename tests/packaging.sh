#!/usr/bin/env bash
# Builds the sdist, and from it the wheel; installs the wheel into a clean environment; tests it with what the sdist holds.
#
#   tests/packaging.sh           with the newest versions of the dependencies
#   tests/packaging.sh lowest    with the lowest ones that pyproject.toml allows (tests/lowest.txt)
#
# What follows goes to pytest. PYTHON is the interpreter, python3 if it is not set.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
lowest=()
if [ "${1:-}" = lowest ]; then
    lowest=(--constraint "$root/tests/lowest.txt")
    shift
fi
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
export MPLBACKEND=Agg PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1

"${PYTHON:-python3}" -m venv "$scratch/tools"
"$scratch/tools/bin/python" -m pip install --quiet build twine
"$scratch/tools/bin/python" -m build --outdir "$scratch/dist" "$root"
"$scratch/tools/bin/python" -m twine check --strict "$scratch/dist"/*

"${PYTHON:-python3}" -m venv "$scratch/venv"
export PATH="$scratch/venv/bin:$PATH"
mkdir "$scratch/empty"
cd "$scratch/empty"
wheel=$(echo "$scratch/dist"/*.whl)
# first what a user has, then what the tests need
python -m pip install --quiet "${lowest[@]}" "$wheel[scenes]"
granphon init
granphon check scene.yaml
granphon run scene.yaml -o out
[ -s out/summary.yaml ]
python -m pip install --quiet "${lowest[@]}" "$wheel[test]"
python -m pip check
python -m pip list

tar -xzf "$scratch/dist"/*.tar.gz -C "$scratch"
cd "$scratch"/granphon-*/
rm -r granphon # so that the package can be imported from the wheel alone
python -m pytest -q "$@"
