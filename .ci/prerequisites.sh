#!/bin/sh
# Checks what building needs: Rust, a C linker, Python with venv. Prints the Python to use, or one line per missing
# thing that says what to install.
rust=1.95
missing=0

missing() {
    echo "missing: $1" >&2
    missing=1
}

# Whether a dotted version is at least another, by major and minor.
at_least() {
    [ "${1%%.*}" -gt "${2%%.*}" ] && return 0
    [ "${1%%.*}" -eq "${2%%.*}" ] || return 1
    rest=${1#*.}
    [ "${rest%%.*}" -ge "${2#*.}" ]
}

install="Rust >= $rust: install it from https://rustup.rs (or run: rustup update)"
if ! found=$(rustc --version 2>/dev/null) || ! cargo --version >/dev/null 2>&1; then
    missing "$install"
else
    found=${found#rustc }
    at_least "${found%%[ -]*}" "$rust" || missing "$install; found ${found%% *}"
fi

# rustc links with cc.
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
echo 'int main(void) { return 0; }' >"$scratch/main.c"
cc "$scratch/main.c" -o "$scratch/main" >/dev/null 2>&1 ||
    missing "a C compiler and linker (cc): install gcc or clang with the C library's headers (Debian, Ubuntu: apt install build-essential)"

python=
for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    missing "Python >= 3.11: install it from https://www.python.org or your system's packages (name another with PYTHON=...)"
elif ! "$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then
    missing "the venv module of $python: install it (Debian, Ubuntu: apt install python3-venv)"
fi

[ "$missing" -eq 0 ] && echo "$python"
