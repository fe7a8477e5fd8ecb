#!/bin/sh
# Prints a working Python 3.10 (lava-nc 0.10 needs exactly that), or says what to do when there is none.
# Looked for, in order: $PYTHON, python3.10 on PATH, pyenv's versions, uv's pythons.
works() { [ -n "$1" ] && "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != (3, 10))' >/dev/null 2>&1; }
try() { if works "$1"; then echo "$1"; exit 0; fi; }

try "$PYTHON"
try "$(command -v python3.10)"
try "$(command -v python3)"
pyenv=$(command -v pyenv)
for root in "$PYENV_ROOT" "$HOME/.pyenv" "${pyenv:+$(dirname "$(dirname "$pyenv")")}"; do
    [ -n "$root" ] || continue
    for python in "$root"/versions/3.10*/bin/python3.10; do try "$python"; done
done
if command -v uv >/dev/null 2>&1; then
    try "$(uv python find --no-project 3.10 2>/dev/null)"
    # uv can fetch one, where the network lets it.
    if uv python install --quiet 3.10 >/dev/null 2>&1; then try "$(uv python find --no-project 3.10 2>/dev/null)"; fi
fi
cat >&2 <<'TEXT'
lava-vpr needs Python 3.10 (its dependency lava-nc 0.10 runs on no other), and none was found. Install one:
    apt install python3.10 python3.10-venv     on Ubuntu 22.04
    pyenv install 3.10                         anywhere, with pyenv (https://github.com/pyenv/pyenv)
    uv python install 3.10                     anywhere, with uv (https://docs.astral.sh/uv)
or name it:  make PYTHON=/path/to/python3.10 demo
TEXT
exit 1
