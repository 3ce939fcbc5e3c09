# Sourced by scripts/clrender, scripts/test and scripts/check: the environment in .venv, or in CLRENDER_VENV, and a working
# OpenCL device.
# Expects `root` to be the checkout. Everything it says goes to stderr.
#
# It removes no environment but one it made. System packages, the packages of an extra that a command needs, and Intel's
# driver, whose licence is not a free one: each is said first, and installed as root, where CLRENDER_INSTALL=1 or --yes
# says so, or where somebody at a terminal agrees. CLRENDER_INSTALL=0 forbids it to root too.

# Images of containers set it to stay small. But pip compiles no module here (`pip_install`), and a start that compiles all
# that it imports takes a second longer, each time.
unset PYTHONDONTWRITEBYTECODE

venv=${CLRENDER_VENV:-$root/.venv}
[[ $venv == /* ]] || venv=$PWD/$venv

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

answer=
# Whether something more than clrender itself may be installed; $1 says what. A terminal is asked once.
allowed() {
    case ${CLRENDER_INSTALL:-} in
        1) return 0 ;;
        0) return 1 ;;
    esac
    [[ $(id -u) != 0 ]] || return 0
    if [[ -z $answer && -t 0 && -t 2 ]]; then
        printf 'clrender set-up: install %s? [y/N] ' "$1" >&2
        read -r answer || true
    fi
    [[ $answer == [yY]* ]] && return 0
    say "not installing $1: as root, or with CLRENDER_INSTALL=1, this would"
    return 1
}

# What makes apt-get run as root: nothing, or sudo, which asks for a password only at a terminal.
as_root=()
find_root() {
    command -v apt-get >/dev/null || return 1
    [[ $(id -u) != 0 ]] || return 0
    command -v sudo >/dev/null || return 1
    if [[ -t 0 ]]; then as_root=(sudo); else as_root=(sudo -n); fi
}

apt_updated=
update_package_lists() {
    [[ -z $apt_updated ]] || return 0
    apt_updated=1
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null 2>&1 || true
}

# Waits where another installs at the same time.
install_packages() {
    find_root && allowed "the system packages $*" || return 1
    say "installing the system packages $*"
    update_package_lists
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600 install -y -qq "$@" \
        >/dev/null 2>&1 && return 0
    say "apt-get could not install $*"
    return 1
}

# What scripts/gpu_static compiles with. libclc and Intel's compiler are only unpacked, into the environment: installed, the
# one would replace the version that rusticl needs, and the other would be a driver.
install_gpu_compilers() {
    local unpacked=$venv/gpu-compilers folder
    install_packages clang-19 || say "without Clang 19 nothing is compiled for NVIDIA's and AMD's GPUs"
    pip_install --quiet 'nvidia-cuda-nvcc-cu12>=12.9,<13' >&2 || say "without ptxas nothing is compiled for NVIDIA's GPUs"
    [[ ! -e $unpacked ]] && find_root || return 0
    folder=$(mktemp -d)
    chmod 755 "$folder"
    if (cd "$folder" && apt-get download -qq libclc-19 intel-opencl-icd libigc1 libigdfcl1 libopencl-clang14 libllvmspirvlib14 \
        libigdgmm12 >/dev/null 2>&1 && for each in *.deb; do dpkg -x "$each" "$folder/unpacked" || exit 1; done); then
        mv "$folder/unpacked" "$unpacked"
    else
        say "libclc and Intel's compiler could not be downloaded; nothing is compiled for AMD's, NVIDIA's and Intel's GPUs"
    fi
    rm -rf "$folder"
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

# In an environment that this script made; only such a one is ever removed.
mark=.made-by-clrender-set-up

make_venv() {
    local python
    python=$(find_python) || fail "Python 3.10 or newer was not found; install it (Debian, Ubuntu: apt-get install python3 python3-venv)"
    if [[ -e $venv ]]; then
        [[ -e $venv/$mark ]] || fail "$venv was not made by this script, and has no Python that works here; move it away, or make it anew with \`$python -m venv $venv\`"
        say "the environment $venv does not work any more; making it anew"
        rm -rf "$venv"
    fi
    say "making the Python environment $venv"
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        install_packages python3-venv \
            || fail "this Python cannot make environments; install its venv package (Debian, Ubuntu: sudo apt-get install python3-venv) and run this again"
    fi
    mkdir -p "$venv"
    touch "$venv/$mark"
    "$python" -m venv "$venv" || fail "$python -m venv $venv failed (see above); on Debian and Ubuntu: sudo apt-get install python3-venv"
}

# Install into the environment, which may have been made without pip, as uv does. Python compiles modules when they are first
# imported, which most of these never are.
pip_install() {
    if "$venv/bin/python" -m pip --version >/dev/null 2>&1 || "$venv/bin/python" -m ensurepip >/dev/null 2>&1; then
        "$venv/bin/python" -m pip install --no-compile --retries 1 --disable-pip-version-check "$@"
    elif command -v uv >/dev/null; then
        uv pip install --python "$venv/bin/python" "$@"
    else
        echo "the environment $venv has neither pip nor ensurepip, and there is no uv"
        return 1
    fi
}

# The same in a tenth of the time, for a hundred packages. uv does not read pip's settings, so where those name an index of
# packages, and wherever uv fails, pip does it.
install_many() {
    if ! "$venv/bin/python" -m pip config list 2>/dev/null | grep -q index && pip_install --quiet uv \
        && UV_NATIVE_TLS=1 "$venv/bin/uv" pip install --python "$venv/bin/python" "$@"; then
        return 0
    fi
    pip_install "$@"
}

# Make the environment and install the package in place; $1 is the extra, or "plain".
make_environment() {
    local what=$root log=$venv/install.log install=pip_install
    [[ $1 == plain ]] || { what="$root[$1]"; install=install_many; }
    if ! "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then make_venv; fi
    # An environment that was moved still points to where it was made.
    if [[ -e $venv/.ready-plain && $(<"$venv/.ready-plain") != "$root" ]]; then make_venv; fi
    say "installing clrender and what it needs into $venv (once; about a minute)"
    if ! "$install" --editable "$what" >"$log" 2>&1; then
        fail "the Python packages could not be installed: $(tail -n 1 "$log"). Is there a network connection? The whole story is in $log"
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

# Install the optional packages $1 that a command lacks. Where that is not allowed, the command says what to do.
install_extra() {
    local log=$venv/install.log list needed
    list=$("$venv/bin/python" -c 'import sys, clrender.extras as extras; print(*extras.packages(sys.argv[1]), sep="\n")' "$1")
    mapfile -t needed <<<"$list"
    allowed "what this command needs (the extra $1): ${needed[*]}" || return 0
    say "installing what this command needs (the extra $1): ${needed[*]}"
    exec 9>"$root/.venv.lock"
    if command -v flock >/dev/null; then flock 9; fi
    pip_install "${needed[@]}" >"$log" 2>&1 \
        || fail "the packages of the extra $1 could not be installed: $(tail -n 1 "$log"). Is there a network connection? The whole story is in $log"
    exec 9>&-
}

# True when `--device auto` finds a device that passes the probe; 4 where a probe ran out of time.
finds_device() {
    "$venv/bin/python" -c '
import sys
from clrender.drivers import select
from clrender.errors import ClrenderError
try:
    select("auto", notify=lambda line: print("clrender set-up:", line, file=sys.stderr))
except ClrenderError as error:
    sys.exit(4 if "timeout" in str(error) else 3)
'
}

# The same. A busy machine is no reason for another driver: a probe that ran out of time gets more of it.
device_works() {
    local status=0
    finds_device || status=$?
    ((status == 4)) && [[ -z ${CLRENDER_PROBE_SECONDS:-} ]] || return "$status"
    say "the check of a driver ran out of time; trying once more, with five times as much"
    CLRENDER_PROBE_SECONDS=1200 finds_device
}

install_wheels() {
    say "installing $* with pip"
    pip_install "$@" >>"$venv/install.log" 2>&1 && return 0
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
    if allowed "Intel's CPU runtime (650 MB; licence: Intel End User License Agreement for Developer Tools)"; then
        say "trying Intel's CPU runtime (650 MB). Its licence: Intel End User License Agreement for Developer Tools"
        if install_wheels intel-opencl-rt intel-cmplr-lib-rt && device_works; then touch "$stamp"; return 0; fi
    fi
    return 1
}
