#!/usr/bin/env bash
# Create the virtual environment and install PlannerForge into it. The Makefile uses this.
#   scripts/setup.sh VENV        the package and its dependencies
#   scripts/setup.sh VENV torch  only torch, into an existing environment
#   scripts/setup.sh VENV dev    dependencies of developers and tests
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
    say "Creating the environment in $venv with $("$python" --version)"
    install_pinned "$python" && return
    say "Some of these versions are not available: pip chooses others"
    lacking=$(lacks_compiler "$python") && fail "one dependency (Polygon3) needs $lacking"
    say "Installing PlannerForge and its dependencies (two to three minutes)"
    install -e .
    "$venv/bin/python" -m pip check
}

install_pinned() {
    # The tested versions without unimported packages, so that no compiler is needed (docs/install.md).
    local pinned=(--no-deps -r packaging/requirements.txt -e .)
    if command -v uv >/dev/null 2>&1; then
        say "Installing PlannerForge and its dependencies by uv (half a minute)"
        [ -x "$venv/bin/python" ] || uv venv --quiet --seed --python "$1" "$venv"
        uv pip install --quiet --python "$venv/bin/python" "${pinned[@]}" && return
        say "uv failed; trying pip"
    fi
    [ -x "$venv/bin/pip" ] || "$1" -m venv "$venv"
    say "Installing PlannerForge and its dependencies by pip (one to two minutes)"
    install "${pinned[@]}"
}

lacks_compiler() {
    # Print what is missing to build Polygon3, which commonroad-drivability-checker requires; fail if nothing is missing.
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
    # On Linux, the default index has a build for CUDA with gigabytes of libraries; PyTorch's own index has one for the CPU.
    local version index
    version=$(pinned torch)
    index=${PLANNERFORGE_TORCH_INDEX:-https://download.pytorch.org/whl/cpu}
    say "Installing torch $version for the CPU from $index"
    if [ "$(uname -s)" = Linux ]; then
        PIP_EXTRA_INDEX_URL='' install --no-deps --retries 0 --timeout 10 --index-url "$index" "torch==$version+cpu" 2>/dev/null && return
        say "It is not available there: installing torch $version from the usual index, which may have the larger build for CUDA"
    fi
    install "torch==$version"
}

has() { "$venv/bin/python" -c "from importlib.util import find_spec; raise SystemExit(find_spec('$1') is None)"; }

pinned() { sed -n "s/^ *\"$1==\([^\"]*\)\".*/\1/p" pyproject.toml; }

# Python compiles a module when it is first imported, as after an installation by uv. pip would compile all of them now,
# which takes longer than to unpack them.
install() { "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile "$@"; }

install_group() {
    if command -v uv >/dev/null 2>&1; then
        development | xargs uv pip install --quiet --python "$venv/bin/python" && return
        say "uv failed; trying pip"
    fi
    development | xargs "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile
}

development() {
    "$venv/bin/python" - <<'PYTHON'
import tomllib

with open("pyproject.toml", "rb") as stream:
    print(*tomllib.load(stream)["dependency-groups"]["dev"], sep="\n")
PYTHON
}

install_polygon() {
    # CommonRoad's checker, which the tests of solutions use, computes the road boundary with Polygon3.
    local lacking
    has Polygon && return
    if lacking=$(lacks_compiler "$venv/bin/python"); then
        say "Tests of solutions are skipped: their checker (Polygon3) needs $lacking"
    else
        say "Building Polygon3 for the tests of solutions"
        install polygon3==3.0.9.1
    fi
}

install_development() {
    # The extra "embeddings" for the tests of other embedding models
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
