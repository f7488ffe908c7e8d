#!/usr/bin/env bash
# Makes the virtual environment and installs PlannerForge into it. Used by the Makefile.
#   scripts/setup.sh VENV        the package and what it needs
#   scripts/setup.sh VENV torch  torch alone, into an environment that is there
#   scripts/setup.sh VENV dev    what developers and tests need besides
set -euo pipefail
venv=${1:?the folder of the virtual environment}
part=${2:-package}
cd "$(dirname "$0")/.."

say() { echo "==> $*"; }
fail() { echo "plannerforge: $*" >&2; exit 1; }

find_python() {
    local name
    for name in python3.11 python3.12 python3 python; do
        if command -v "$name" >/dev/null 2>&1 &&
            "$name" -c 'import sys; raise SystemExit(not (3, 11) <= sys.version_info[:2] < (3, 13))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    if command -v uv >/dev/null 2>&1; then
        uv python install 3.11 >&2 && uv python find 3.11
        return
    fi
    fail "needs Python 3.11 or 3.12. Get it with: curl -LsSf https://astral.sh/uv/install.sh | sh && uv python install 3.11"
}

install_package() {
    local python lacking
    python=$(find_python)
    say "Making the environment in $venv with $("$python" --version)"
    install_pinned "$python" && return
    say "Some of these versions cannot be had here: pip chooses others"
    lacking=$(lacks_compiler "$python") && fail "one dependency (Polygon3) needs $lacking"
    say "Installing PlannerForge and its dependencies (two to three minutes)"
    install -e .
    "$venv/bin/python" -m pip check
}

install_pinned() {
    # The versions that the tests ran with, and none of what nothing imports, so that no compiler is needed (docs/install.md).
    local pinned=(--no-deps -r packaging/requirements.txt -e .)
    if command -v uv >/dev/null 2>&1; then
        say "Installing PlannerForge and its dependencies by uv (half a minute)"
        [ -x "$venv/bin/python" ] || uv venv --quiet --seed --python "$1" "$venv"
        uv pip install --quiet --python "$venv/bin/python" "${pinned[@]}" && return
        say "uv could not; pip does it"
    fi
    [ -x "$venv/bin/pip" ] || "$1" -m venv "$venv"
    say "Installing PlannerForge and its dependencies by pip (one to two minutes)"
    install "${pinned[@]}"
}

lacks_compiler() {
    # Says what is missing to build Polygon3, which commonroad-drivability-checker asks for; fails where nothing is.
    local header
    if ! command -v cc >/dev/null 2>&1 && ! command -v gcc >/dev/null 2>&1 && ! command -v clang >/dev/null 2>&1; then
        echo "a C compiler (sudo apt-get install gcc, or your system's equivalent)"
        return
    fi
    header=$("$1" -c 'import sysconfig; print(sysconfig.get_paths()["include"])')/Python.h
    [ -f "$header" ] && return 1
    echo "Python's headers, as $header is missing (sudo apt-get install python3-dev)"
}

install_torch() {
    # The usual index has a build for CUDA on Linux, with gigabytes of libraries; PyTorch's own one has one for the CPU.
    local version index
    version=$(pinned torch)
    index=${PLANNERFORGE_TORCH_INDEX:-https://download.pytorch.org/whl/cpu}
    say "Installing torch $version for the CPU from $index"
    if [ "$(uname -s)" = Linux ]; then
        PIP_EXTRA_INDEX_URL='' install --no-deps --retries 0 --timeout 10 --index-url "$index" "torch==$version+cpu" 2>/dev/null && return
        say "It cannot be had there: installing torch $version from the usual index, which may hold the larger build for CUDA"
    fi
    install "torch==$version"
}

has() { "$venv/bin/python" -c "from importlib.util import find_spec; raise SystemExit(find_spec('$1') is None)"; }

pinned() { sed -n "s/^ *\"$1==\([^\"]*\)\".*/\1/p" pyproject.toml; }

install() { "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@"; }

install_group() {
    if command -v uv >/dev/null 2>&1; then
        development | xargs uv pip install --quiet --python "$venv/bin/python" && return
        say "uv could not; pip does it"
    fi
    development | xargs "$venv/bin/python" -m pip install --quiet --disable-pip-version-check
}

development() {
    "$venv/bin/python" - <<'PYTHON'
import tomllib

with open("pyproject.toml", "rb") as stream:
    print(*tomllib.load(stream)["dependency-groups"]["dev"], sep="\n")
PYTHON
}

install_polygon() {
    # CommonRoad's own checker, which solutions are held against in the tests, draws the road's edge by Polygon3.
    local lacking
    has Polygon && return
    if lacking=$(lacks_compiler "$venv/bin/python"); then
        say "Tests of solutions are skipped: the checker that they are held against (Polygon3) needs $lacking"
    else
        say "Building Polygon3, which tests of solutions need"
        install polygon3==3.0.9.1
    fi
}

install_development() {
    # The extra "embeddings", which tests of other embedding models need
    if ! has torch || ! has sentence_transformers; then
        install_torch
        install "sentence-transformers==$(pinned sentence-transformers)"
    fi
    install_polygon
    say "Installing the developers' tools"
    install_group
}

case $part in
    package) install_package ;;
    torch) install_torch ;;
    dev) install_development ;;
    *) fail "no part '$part'; there are package, torch, dev" ;;
esac
