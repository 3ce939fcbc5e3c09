# Sourced by scripts/clrender, scripts/test and scripts/check: the environment in .venv and a working OpenCL device.
# Expects `root` to be the checkout. Everything it says goes to stderr.

venv=$root/.venv

say() { printf 'clrender set-up: %s\n' "$*" >&2; }
fail() {
    printf 'error: %s\n' "$1" >&2
    exit "${2:-1}"
}

# True when this environment has what `setup.cfg` asks for; $1 is the extra, or "plain".
environment_ready() {
    local stamp=$venv/.ready-$1
    # A stamp also holds the folder it was made in: an environment does not survive being moved.
    [[ $stamp -nt $root/setup.cfg && -x $venv/bin/clrender && $(<"$stamp") == "$root" ]]
}

as_root=()
may_install_packages() {
    command -v apt-get >/dev/null || return 1
    if [[ $(id -u) == 0 ]]; then as_root=(); return 0; fi
    command -v sudo >/dev/null && sudo -n true 2>/dev/null && as_root=(sudo -n)
}

apt_updated=
install_packages() {
    may_install_packages || return 1
    say "installing the system packages $*"
    if [[ -z $apt_updated ]]; then
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null 2>&1 || true
        apt_updated=1
    fi
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >/dev/null 2>&1 && return 0
    say "apt-get could not install $*"
    return 1
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-} python3 python3.13 python3.12 python3.11 python3.10; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
            printf '%s' "$candidate"
            return 0
        fi
    done
    return 1
}

make_venv() {
    local python
    python=$(find_python) || fail "Python 3.10 or newer was not found; install it (Debian, Ubuntu: apt-get install python3 python3-venv)"
    say "making the Python environment $venv"
    rm -rf "$venv"
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        install_packages python3-venv \
            || fail "this Python cannot make environments; install its venv package (Debian, Ubuntu: sudo apt-get install python3-venv) and run this again"
    fi
    "$python" -m venv "$venv" || fail "$python -m venv $venv failed (see above); on Debian and Ubuntu: sudo apt-get install python3-venv"
}

# Make the environment and install the package in place; $1 is the extra, or "plain".
make_environment() {
    local what=$root log=$root/.venv/install.log
    [[ $1 == plain ]] || what="$root[$1]"
    if [[ ! -x $venv/bin/python ]] || ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then make_venv; fi
    # An environment that was moved still points to where it was made.
    if [[ -e $venv/.ready-plain && $(<"$venv/.ready-plain") != "$root" ]]; then make_venv; fi
    say "installing clrender and what it needs (once; about a minute)"
    if ! "$venv/bin/python" -m pip install --retries 1 --disable-pip-version-check --editable "$what" >"$log" 2>&1; then
        fail "the Python packages could not be installed; is there a network connection? The whole story is in $log"
    fi
    printf '%s' "$root" >"$venv/.ready-plain"
    printf '%s' "$root" >"$venv/.ready-$1"
}

# One set-up at a time, or two first calls would write into each other's environment.
ensure_environment() {
    environment_ready "$1" && return 0
    exec 9>"$root/.venv.lock"
    if command -v flock >/dev/null; then flock 9; fi
    environment_ready "$1" || make_environment "$1"
    exec 9>&-
}

# True when `--device auto` finds a device that passes the probe.
device_works() {
    "$venv/bin/python" -c '
import sys
from clrender.device import select
from clrender.errors import ClrenderError
try:
    select("auto", notify=lambda line: print("clrender set-up:", line, file=sys.stderr))
except ClrenderError:
    sys.exit(3)
'
}

install_wheels() {
    say "installing $* with pip"
    "$venv/bin/python" -m pip install --retries 1 --disable-pip-version-check "$@" >>"$venv/install.log" 2>&1 && return 0
    say "pip could not install $* (see $venv/install.log)"
    return 1
}

# Look for a driver that works: what is there, the system's PoCL, PoCL's wheel, Intel's wheels.
ensure_device() {
    local stamp=$venv/.device-works
    [[ -e $stamp ]] && return 0
    if device_works; then touch "$stamp"; return 0; fi
    say "no OpenCL driver on this machine passes the probe yet"
    if install_packages pocl-opencl-icd && device_works; then touch "$stamp"; return 0; fi
    if install_wheels pocl-binary-distribution; then
        if device_works; then touch "$stamp"; return 0; fi
        # Its compiler does not know processors newer than itself; a device that cannot build only confuses.
        "$venv/bin/python" -m pip uninstall --quiet --yes pocl-binary-distribution >/dev/null 2>&1 || true
    fi
    say "trying Intel's CPU runtime (650 MB). Its licence: Intel End User License Agreement for Developer Tools"
    if install_wheels intel-opencl-rt intel-cmplr-lib-rt && device_works; then touch "$stamp"; return 0; fi
    return 1
}
