# Shared by the commands in script/. Sourced, never run.
# shellcheck shell=bash
#
# prepare: system packages, .venv and the locked Python packages, each only
# where something is missing; `prepare tests` also what only tests and development need.
# Says on stderr what it does; silent otherwise.
# With CI=true, or once they were asked for here, also the extras `metrics` and `docs` and the TOOLS;
# the other EXTRAS once `script/setup --NAME` was run.

set -euo pipefail

ROOT=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
VENV="$ROOT/.venv"
LOCK="$ROOT/requirements.lock"              # what metamerlab itself needs
SETUP_LOCK="$ROOT/requirements-setup.lock"  # uv and pip, which install these
EXTRAS="test metrics metamers docs"         # requirements-NAME.lock and .txt
ASKED_EXTRA=""                              # script/setup --NAME, script/docs
FOR_TESTS=""                                # prepare tests
PYTHON_FOUND=""                             # only where .venv has to be made
MINIMUM_PYTHON=3.11
SYSTEM_PYTHON=${SYSTEM_PYTHON:-/usr/bin/python3} # the tests of this file have another

# Packages that a Debian or Ubuntu machine needs beside Python, and how any other system can be
# asked for it: a library (lib:), a command (cmd:) or nothing (-). Tests need a screen, too.
SYSTEM_PACKAGES="
libegl1             lib:libEGL.so.1
libegl-mesa0        -
libgl1              lib:libGL.so.1
libgl1-mesa-dri     -
libfribidi0         lib:libfribidi.so.0
fonts-dejavu-core   -
"
SCREEN_PACKAGES="
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

# Sets PYTHON_FOUND: $PYTHON where the user names one, else the first of those that are new enough
# which is about as fast as the fastest.
find_python() {
    local candidate found ms least=0 known=" "
    if [[ -n ${PYTHON:-} ]]; then
        command -v -- "$PYTHON" >/dev/null ||
            stop "PYTHON=$PYTHON: no such program; name a Python $MINIMUM_PYTHON or newer"
        is_new_enough "$PYTHON" ||
            stop "metamerlab needs Python $MINIMUM_PYTHON or newer (PYTHON=$PYTHON is $("$PYTHON" -V 2>&1))"
        PYTHON_FOUND=$(command -v -- "$PYTHON")
        return
    fi
    local -a places=() times=()
    for candidate in python3 "$SYSTEM_PYTHON" python3.14 python3.13 python3.12 python3.11; do
        if ! found=$(command -v "$candidate") || [[ $known == *" $found "* ]]; then continue; fi
        known+="$found "
        if ms=$("$found" -I "$ROOT/study_app/doctor/python_speed.py" 2>/dev/null); then
            places+=("$found") times+=("$ms")
            if ((least == 0 || ms < least)); then least=$ms; fi
        fi
    done
    for candidate in "${!places[@]}"; do
        if ((4 * times[candidate] <= 5 * least)); then
            PYTHON_FOUND=${places[candidate]}
            return
        fi
    done
    local found="none"
    command -v python3 >/dev/null && found="$(python3 -V 2>&1) at $(command -v python3)"
    stop "metamerlab needs Python $MINIMUM_PYTHON or newer (found $found).
Install one, or name it: PYTHON=/path/to/python3.12 script/setup"
}

# Prints a Python whose pip can install into another environment.
python_with_pip() {
    local candidate
    for candidate in "$PYTHON_FOUND" python3 "$SYSTEM_PYTHON"; do
        if env -u PYTHONHOME -u PYTHONPATH "$candidate" -m pip --python "$candidate" --version \
            >/dev/null 2>&1; then
            printf '%s\n' "$candidate"
            return
        fi
    done
}

# Prints the package that lets this Python make an environment with pip (Debian splits it off), if
# it needs it: not where a pip is at hand.
missing_venv_package() {
    [[ -n $PYTHON_FOUND && -z $(python_with_pip) ]] || return 0
    "$PYTHON_FOUND" -I -c 'import ensurepip, venv' 2>/dev/null && return
    "$PYTHON_FOUND" -I -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'
}

# Prints the packages of a Debian machine, a line each, with how another system can be asked.
system_packages() {
    printf '%s\n' "$SYSTEM_PACKAGES"
    if wants_extra test; then printf '%s\n' "$SCREEN_PACKAGES"; fi
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
    names=$(system_packages | awk 'NF { print $1 }')
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
            lib:*) "${PYTHON_FOUND:-$VENV/bin/python}" -I -c "import ctypes; ctypes.CDLL('${probe#lib:}')" 2>/dev/null ||
                say "  the library ${probe#lib:} (Debian: $name)" ;;
        esac
    done <<<"$(system_packages)"
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
    local into=("$VENV/bin/python" -m pip)
    "$VENV/bin/python" -I -c 'import pip' 2>/dev/null ||
        into=("$(python_with_pip)" -m pip --python "$VENV/bin/python")
    env -u PIP_USER -u PIP_TARGET -u PIP_PREFIX -u PIP_ROOT -u PYTHONHOME -u PYTHONPATH \
        "${into[@]}" --disable-pip-version-check --no-input "$@"
}

# Prints what pip is told by the name $1, in variables before files.
told_pip() {
    awk -F = -v name="$1" -v quote="'" '
        { place = $1; value = substr($0, length($1) + 2); gsub("^" quote "|" quote "$", "", value)
          rank = place == ":env:." name ? 3 : place == "install." name ? 2 : place == "global." name }
        rank > best { best = rank; found = value }
        END { if (best) print found }' <<<"$PIP_TOLD"
}

# uv, which is asked for packages where the user's pip would ask.
uv_here() {
    local name value settings=(UV_INDEX_STRATEGY=unsafe-best-match UV_LINK_MODE=copy)
    PIP_TOLD=${PIP_TOLD:-$(pip_here config list 2>/dev/null)}
    while read -r name value; do
        value=$(told_pip "$value")
        if [[ -n $value ]]; then settings+=("$name=$value"); fi
    done <<<"UV_DEFAULT_INDEX index-url
UV_INDEX extra-index-url
UV_FIND_LINKS find-links
UV_INSECURE_HOST trusted-host
SSL_CERT_FILE cert
ALL_PROXY proxy
UV_HTTP_TIMEOUT default-timeout"
    env -u PYTHONHOME -u PYTHONPATH "${settings[@]}" "$VENV/bin/uv" --no-config --no-progress "$@" \
        --python "$VENV/bin/python"
}

# Installs by uv, in seconds; by pip, in minutes, where uv is not there or fails.
add_packages() {
    if [[ -x $VENV/bin/uv ]]; then
        if quietly uv_here pip install "$@"; then return; fi
        say "pip is tried in place of uv"
    fi
    quietly pip_here install --no-user --no-compile "$@"
}

make_environment() {
    local without_pip=()
    [[ -n $PYTHON_FOUND ]] || find_python
    say "Making the virtual environment .venv with $("$PYTHON_FOUND" -V) ($PYTHON_FOUND)"
    if [[ -n $(python_with_pip) ]]; then without_pip=(--without-pip); fi
    quietly "$PYTHON_FOUND" -I -m venv --clear "${without_pip[@]}" "$VENV"
    touch -- "$VENV/metamerlab-unfinished" # gone only when all is done: else start over
    quietly pip_here install --no-user --no-compile --require-hashes --only-binary :all: \
        -r "$SETUP_LOCK" || say "uv is not to be had; pip takes its place, which takes minutes"
}

install_python_packages() {
    local unfinished="$VENV/metamerlab-unfinished"
    rm -f -- "$VENV/metamerlab-stamp"
    if [[ -e $unfinished ]] || ! venv_is_usable; then
        make_environment
    fi
    touch -- "$unfinished"
    say "Installing the locked Python packages into .venv (600 MB)"
    add_packages --require-hashes --only-binary :all: -r "$LOCK"
    add_packages --no-deps --no-index --no-build-isolation --editable "$ROOT"
    rm -f -- "$unfinished"
    wanted_stamp >"$VENV/metamerlab-stamp.new"
    mv -- "$VENV/metamerlab-stamp.new" "$VENV/metamerlab-stamp" # last: all or nothing
}

# What tests need, `metrics` and `docs` are wanted by CI, all by whoever asks for them, or did here
# before.
wants_extra() {
    [[ $1 == "$ASKED_EXTRA" || -e $VENV/metamerlab-$1 || ($1 == test && -n $FOR_TESTS) ]] ||
        [[ ${CI:-} == true && $1 =~ ^(test|metrics|docs)$ ]]
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

# All but torch has one build and is held to its hashes. The locked versions stay as they are: the
# installer is told of them as constraints. Which build of torch comes, for CPU or GPU, is decided
# by where pip looks (PIP_EXTRA_INDEX_URL).
install_extra() {
    local name=$1 locked="$VENV/metamerlab-locked.txt" size
    case $name in
        test) size="340 MB" ;;
        docs) size="60 MB" ;;
        *) size="torch: some 200 MB, several GB with CUDA" ;;
    esac
    say "Installing what is needed for $name ($size)"
    for file in "$ROOT/requirements-$name".{lock,txt}; do
        if [[ ! -e $file ]]; then continue; fi
        if [[ $name == test || $name == docs ]]; then
            add_packages --require-hashes --no-deps --only-binary :all: -r "$file"
        elif [[ $file == *.lock ]]; then # what metrics need comes as a source, too
            add_packages --require-hashes --no-deps -r "$file"
        else
            pins_of "$LOCK" >"$locked"
            add_packages --constraint "$locked" -r "$file"
        fi
    done
    wanted_extra_stamp "$name" >"$VENV/metamerlab-$name.new"
    mv -- "$VENV/metamerlab-$name.new" "$VENV/metamerlab-$name"
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

# prepare [tests]
prepare() {
    local wanted name tools
    cd -- "$ROOT"
    FOR_TESTS=${1:-}
    if [[ -n ${PYTHON:-} ]] || ! venv_is_usable; then find_python; fi
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
            has_extra "$name" || install_extra "$name"
        done
        if [[ -n $tools ]]; then
            wait "$tools"
            wanted_tools_stamp >"$VENV/metamerlab-tools.new"
            mv -- "$VENV/metamerlab-tools.new" "$VENV/metamerlab-tools"
        fi
    ) 9<"$LOCK"
}
