# Shared by the commands in script/. Sourced, never run.
# shellcheck shell=bash
#
# prepare: system packages, .venv and the locked Python packages, each only
# where something is missing. Says on stderr what it does; silent otherwise.
# With CI=true, or once they were asked for here, also the extras `metrics` and `docs` and the TOOLS;
# the other EXTRAS once `script/setup --NAME` was run.

set -euo pipefail

ROOT=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
VENV="$ROOT/.venv"
LOCK="$ROOT/requirements.lock"
EXTRAS="metrics metamers denoise docs" # requirements-NAME.txt and .lock; without torch one of them
ASKED_EXTRA=""                          # script/setup --NAME, script/docs
MINIMUM_PYTHON=3.11

# Packages that a Debian or Ubuntu machine needs beside Python, and how any other system
# can be asked for it: a library (lib:), a command (cmd:) or nothing (-).
SYSTEM_PACKAGES="
libegl1             lib:libEGL.so.1
libegl-mesa0        -
libgl1              lib:libGL.so.1
libgl1-mesa-dri     -
libfribidi0         lib:libfribidi.so.0
fonts-dejavu-core   -
xvfb                cmd:Xvfb
xauth               cmd:xauth
xdotool             cmd:xdotool
openbox             cmd:openbox
"

# Packages that tests of the web part, of desktops and of the statistics need beside these, and which commands do as well.
TOOLS="
chromium            chromium google-chrome chromium-browser
firefox-esr         firefox-esr firefox
xcompmgr            xcompmgr
r-cran-lme4         -
r-cran-ordinal      -
"
WEB="$ROOT/study_app/web" # its Node packages are locked there
MINIMUM_NODE=20.19

say() { printf '%s\n' "$*" >&2; }

# The user has to do something first: exit status 2.
stop() {
    say "$*"
    exit 2
}

# Runs a command silently; shows the end of what it said if it fails.
quietly() {
    local log
    log=$(mktemp "${TMPDIR:-/tmp}/metamerlab-setup.XXXXXX")
    if "$@" </dev/null >"$log" 2>&1; then
        rm -f -- "$log"
    else
        tail -n 25 -- "$log" >&2
        say "failed: $*"
        say "everything it said: $log"
        return 1
    fi
}

is_new_enough() {
    "$1" -I -c "import sys; sys.exit(sys.version_info < (${MINIMUM_PYTHON/./, }))" 2>/dev/null
}

# Sets PYTHON_FOUND: $PYTHON where the user names one, else the first that is new enough.
find_python() {
    local candidate
    if [[ -n ${PYTHON:-} ]]; then
        command -v -- "$PYTHON" >/dev/null ||
            stop "PYTHON=$PYTHON: no such program; name a Python $MINIMUM_PYTHON or newer"
        is_new_enough "$PYTHON" ||
            stop "metamerlab needs Python $MINIMUM_PYTHON or newer (PYTHON=$PYTHON is $("$PYTHON" -V 2>&1))"
        PYTHON_FOUND=$(command -v -- "$PYTHON")
        return
    fi
    for candidate in python3 python3.14 python3.13 python3.12 python3.11; do
        if command -v "$candidate" >/dev/null && is_new_enough "$candidate"; then
            PYTHON_FOUND=$(command -v "$candidate")
            return
        fi
    done
    local found="none"
    command -v python3 >/dev/null && found="$(python3 -V 2>&1) at $(command -v python3)"
    stop "metamerlab needs Python $MINIMUM_PYTHON or newer (found $found).
Install one, or name it: PYTHON=/path/to/python3.12 script/setup"
}

# Prints the package that gives this Python `venv`, if it lacks it (Debian splits it off).
missing_venv_package() {
    "$PYTHON_FOUND" -I -c 'import ensurepip, venv' 2>/dev/null && return
    "$PYTHON_FOUND" -I -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'
}

# Prints the TOOLS whose commands are not here; those that have none as they are.
wanted_tools() {
    local name commands
    while read -r name commands; do
        # shellcheck disable=SC2086  # one word per command
        [[ -z $name ]] || { [[ $commands != - ]] && command -v $commands >/dev/null; } ||
            printf '%s\n' "$name"
    done <<<"$TOOLS"
}

missing_debian_packages() {
    local names installed name
    names=$(awk 'NF { print $1 }' <<<"$SYSTEM_PACKAGES")
    if wants_tools; then names+=$'\n'$(wanted_tools); fi
    # shellcheck disable=SC2086  # one word per package
    installed=$(dpkg-query -W -f='${db:Status-Status} ${Package}\n' $names 2>/dev/null |
        awk '$1 == "installed" { print $2 }' || true)
    for name in $names; do
        grep -qxF -- "$name" <<<"$installed" || printf '%s\n' "$name"
    done
    missing_venv_package
}

missing_capabilities() {
    local name probe
    while read -r name probe; do
        case $probe in
            cmd:*) command -v "${probe#cmd:}" >/dev/null || say "  the command ${probe#cmd:} (Debian: $name)" ;;
            lib:*) "$PYTHON_FOUND" -I -c "import ctypes; ctypes.CDLL('${probe#lib:}')" 2>/dev/null ||
                say "  the library ${probe#lib:} (Debian: $name)" ;;
        esac
    done <<<"$SYSTEM_PACKAGES"
    if [[ -n $(missing_venv_package) ]]; then
        say "  the modules venv and ensurepip of $PYTHON_FOUND"
    fi
}

# Debian and its children are mended where we may; elsewhere we say what is missing.
need_system_packages() {
    local missing as_root=()
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        missing=$(missing_capabilities 2>&1)
        [[ -z $missing ]] || stop "metamerlab needs, and this system does not have:
$missing
Install them with your package manager, then run this again."
        return
    fi
    missing=$(missing_debian_packages | tr '\n' ' ')
    missing=${missing% }
    [[ -n $missing ]] || return 0
    if [[ $(id -u) != 0 ]]; then
        if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
            as_root=(sudo -n)
        else
            stop "System packages are missing, and installing them needs root. Run:
  sudo apt-get install --yes --no-install-recommends $missing
then run this again."
        fi
    fi
    say "Installing system packages: $missing"
    as_root+=(env DEBIAN_FRONTEND=noninteractive)
    # An apt that was interrupted earlier leaves packages half set up.
    quietly "${as_root[@]}" dpkg --configure -a
    quietly "${as_root[@]}" apt-get -o DPkg::Lock::Timeout=300 update
    # shellcheck disable=SC2086
    quietly "${as_root[@]}" apt-get -o DPkg::Lock::Timeout=300 install --yes \
        --no-install-recommends $missing
}

# One line that changes when the Python packages have to be installed again.
# The folder is part of it: a moved virtual environment does not work.
wanted_stamp() {
    local hash
    hash=$(cat -- "$LOCK" "$ROOT/pyproject.toml" | sha256sum)
    printf '%s %s\n' "${hash%% *}" "$ROOT"
}

# .venv runs, and on the Python that the user asked for, if one was asked for.
venv_is_usable() {
    is_new_enough "$VENV/bin/python" &&
        [[ -z ${PYTHON:-} || $("$VENV/bin/python" -V) == "$("$PYTHON_FOUND" -V)" ]]
}

is_ready() {
    [[ -f $VENV/metamerlab-stamp && $(<"$VENV/metamerlab-stamp") == "$(wanted_stamp)" ]] &&
        venv_is_usable
}

# Settings of the user's pip that would install elsewhere are left aside; where
# packages come from (indexes, proxies, certificates) stays the user's.
pip_here() {
    env -u PIP_USER -u PIP_TARGET -u PIP_PREFIX -u PIP_ROOT -u PYTHONHOME -u PYTHONPATH \
        "$VENV/bin/python" -m pip --disable-pip-version-check --no-input "$@"
}

install_python_packages() {
    local unfinished="$VENV/metamerlab-unfinished"
    rm -f -- "$VENV/metamerlab-stamp"
    if [[ -e $unfinished ]] || ! venv_is_usable ||
        ! "$VENV/bin/python" -I -c 'import pip' 2>/dev/null; then
        say "Making the virtual environment .venv with $("$PYTHON_FOUND" -V)"
        quietly "$PYTHON_FOUND" -I -m venv --clear "$VENV"
    fi
    touch -- "$unfinished" # gone only when all is done: else start over
    say "Installing the locked Python packages into .venv (1.2 GB; minutes on a fresh machine)"
    quietly pip_here install --no-user --no-compile --require-hashes --only-binary :all: -r "$LOCK"
    quietly pip_here install --no-user --no-deps --no-index --no-build-isolation \
        --editable "$ROOT"
    rm -f -- "$unfinished"
    wanted_stamp >"$VENV/metamerlab-stamp.new"
    mv -- "$VENV/metamerlab-stamp.new" "$VENV/metamerlab-stamp" # last: all or nothing
}

# The extras `metrics` and `docs` are wanted by CI, all by whoever asks for them, or did here before.
wants_extra() {
    [[ $1 == "$ASKED_EXTRA" || -e $VENV/metamerlab-$1 ]] ||
        [[ ${CI:-} == true && ($1 == metrics || $1 == docs) ]]
}

wanted_extra_stamp() {
    cat -- "$ROOT/requirements-$1".* "$LOCK" | sha256sum
}

has_extra() {
    local stamp="$VENV/metamerlab-$1"
    [[ -f $stamp && $(<"$stamp") == "$(wanted_extra_stamp "$1")" ]]
}

# Prints the versions of a file with hashes, without the hashes.
pins_of() { awk '/^[A-Za-z0-9]/ { sub(/ *\\$/, ""); print }' "$1"; }

# All but torch has one build and is held to its hashes. The locked versions stay as they are: pip is
# told of them as constraints. Which build of torch comes, for CPU or GPU, is decided by where pip
# looks (PIP_EXTRA_INDEX_URL).
install_extra() {
    local name=$1 locked="$VENV/metamerlab-locked.txt"
    pins_of "$LOCK" >"$locked"
    local size="torch: some 200 MB, several GB with CUDA"
    [[ -f $ROOT/requirements-$name.txt ]] || size="Mitsuba: 200 MB"
    say "Installing the extra $name ($size)"
    quietly pip_here install --no-user --no-compile --prefer-binary --require-hashes --no-deps \
        -r "$ROOT/requirements-$name.lock"
    [[ ! -f $ROOT/requirements-$name.txt ]] ||
        quietly pip_here install --no-user --no-compile --prefer-binary --constraint "$locked" \
            -r "$ROOT/requirements-$name.txt"
    wanted_extra_stamp "$name" >"$VENV/metamerlab-$name.new"
    mv -- "$VENV/metamerlab-$name.new" "$VENV/metamerlab-$name"
}

# Pinned with hashes and agreeing with the lock: these packages are the same everywhere.
install_docs() {
    say "Installing the extra docs (Sphinx: 60 MB)"
    quietly pip_here install --no-user --no-compile --require-hashes --only-binary :all: \
        -r "$ROOT/requirements-docs.txt"
    wanted_extra_stamp docs >"$VENV/metamerlab-docs.new"
    mv -- "$VENV/metamerlab-docs.new" "$VENV/metamerlab-docs"
}

# What pip would do file by file, on all processors: it takes as long as to unpack them. Some files
# that packages bring are no Python of this version.
compile_packages() {
    "$VENV/bin/python" -I -m compileall -q -j 0 "$VENV/lib" >/dev/null 2>&1 || true
}

# The tools are wanted by CI, by whoever asks for them, or did here before.
wants_tools() {
    [[ $ASKED_EXTRA == tools || -e $VENV/metamerlab-tools || ${CI:-} == true ]]
}

wanted_tools_stamp() { sha256sum <"$WEB/package-lock.json"; }

has_tools() {
    [[ -d $WEB/node_modules && -f $VENV/metamerlab-tools ]] &&
        [[ $(<"$VENV/metamerlab-tools") == "$(wanted_tools_stamp)" ]]
}

# Node itself comes from the user: Debian 12 has an older one than the web part needs.
install_tools() {
    local enough="process.exit(process.versions.node.localeCompare('$MINIMUM_NODE', 'en', {numeric: true}) < 0 ? 1 : 0)"
    command -v npm >/dev/null && node -e "$enough" ||
        stop "the web part needs Node $MINIMUM_NODE or newer, with npm (found $(node --version 2>/dev/null || echo none)).
Install it, then run this again"
    say "Installing the web part's Node packages (100 MB)"
    quietly npm ci --prefix "$WEB"
}

has_wanted_extras() {
    local name
    if wants_tools; then has_tools || return; fi
    for name in $EXTRAS; do
        ! wants_extra "$name" || has_extra "$name" || return
    done
}

prepare() {
    cd -- "$ROOT"
    find_python
    need_system_packages
    is_ready && has_wanted_extras && return
    (
        # Two commands started together: the second waits, then finds all done.
        if command -v flock >/dev/null; then flock 9; fi
        wanted=""
        for name in $EXTRAS; do # a new environment forgets the wish
            ! wants_extra "$name" || wanted+=" $name"
        done
        tools=""
        if wants_tools && ! has_tools; then
            install_tools &
            tools=$!
        fi
        is_ready || install_python_packages
        for name in $wanted; do
            if has_extra "$name"; then continue; fi
            if [[ $name == docs ]]; then install_docs; else install_extra "$name"; fi
        done
        compile_packages
        if [[ -n $tools ]]; then
            wait "$tools"
            wanted_tools_stamp >"$VENV/metamerlab-tools.new"
            mv -- "$VENV/metamerlab-tools.new" "$VENV/metamerlab-tools"
        fi
    ) 9<"$LOCK"
}
