#!/bin/sh
# Prints a working Python, or says what to do when there is none.
#   find_python.sh        3.10, under which Lava runs; without one any newer, and one line says what is left out
#   find_python.sh 3.12   that version alone
# $PYTHON, if it is set and of such a version, goes first; then PATH, pyenv's versions, uv's pythons.
wanted=$1
known="3.12 3.13 3.11 3.14" # newer ones, in the order in which they are taken
works() { [ -n "$1" ] && "$1" -c "import sys, venv, ensurepip; sys.exit('%d.%d' % sys.version_info[:2] != '$2')" >/dev/null 2>&1; }
try() { if works "$1" "$version"; then echo "$1"; exit 0; fi; }
pyenv=$(command -v pyenv)

find_version() { # prints the path of a Python $1 and exits with 0, in a subshell; 1 without
    version=$1
    try "$PYTHON"
    try "$(command -v "python$version")"
    try "$(command -v python3)"
    for root in "$PYENV_ROOT" "$HOME/.pyenv" "${pyenv:+$(dirname "$(dirname "$pyenv")")}"; do
        [ -n "$root" ] || continue
        for python in "$root/versions/$version".*/bin/"python$version"; do try "$python"; done
    done
    command -v uv >/dev/null 2>&1 && try "$(uv python find --no-project "$version" 2>/dev/null)"
    exit 1
}

if [ -n "$wanted" ]; then
    python=$(find_version "$wanted") || { echo "no Python $wanted with venv was found (on PATH, in pyenv, by uv)" >&2; exit 1; }
    echo "$python"
    exit 0
fi
if [ -n "$PYTHON" ]; then # named: it is taken, or refused
    version=$("$PYTHON" -c 'import sys, venv, ensurepip; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
    case $version in
    3.1[0-9]) python=$PYTHON ;;
    *) echo "PYTHON=$PYTHON: is no Python of 3.10 or newer with venv; name another, or none" >&2; exit 1 ;;
    esac
else
    # uv can fetch a 3.10, where the network lets it.
    python=$(find_version 3.10) || { uv python install --quiet 3.10 >/dev/null 2>&1 && python=$(find_version 3.10); } || python=
    for version in $known; do
        [ -n "$python" ] || python=$(find_version "$version")
    done
fi
if [ -z "$python" ]; then
    cat >&2 <<'TEXT'
lava-vpr needs Python 3.10 or newer with venv, and none was found. Install one, best 3.10, the only one that Lava runs under:
    apt install python3.10 python3.10-venv     on Ubuntu 22.04; on others python3 python3-venv
    pyenv install 3.10                         anywhere, with pyenv (https://github.com/pyenv/pyenv)
    uv python install 3.10                     anywhere, with uv (https://docs.astral.sh/uv)
or name it:  make PYTHON=/path/to/python3.10 demo
TEXT
    exit 1
fi
works "$python" 3.10 ||
    echo "$("$python" --version): Lava's parts are left out, as lava-nc runs under Python 3.10 alone; all else works" >&2
echo "$python"
