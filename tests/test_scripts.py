"""Behaviour of script/lib.sh on machines that lack something, on a machine made of fakes."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

# Real programs that the scripts may use; nothing else of this machine is on their PATH.
TOOLS = (
    *("awk", "bash", "cat", "cp", "dirname", "env", "flock", "grep", "id", "mkdir", "mktemp"),
    *("mv", "rm", "sed", "sha256sum", "sort", "tail", "touch", "tr"),
)

# uv, which says what it was asked, and of where; and fails when told to.
FAKE_UV = """#!/bin/bash
from="index=$UV_DEFAULT_INDEX also=$UV_INDEX links=$UV_FIND_LINKS cert=$SSL_CERT_FILE"
echo "uv $* $from" >>"$MACHINE/log"
[[ ! -e $MACHINE/fail-uv ]] || { echo "uv cannot"; exit 1; }
"""
# A Python that is new enough, makes a "virtual environment" of itself, and whose pip
# installs nothing but uv and says what it was asked, and fails or dies when told to.
FAKE_PYTHON = """#!/bin/bash
case "$*" in
    *version_info\\ \\<*) exit "$(cat "$MACHINE/too-old" 2>/dev/null || echo 0)" ;;
    *python_speed*) [[ ! -e $MACHINE/too-old ]] || exit 1
        cat "$MACHINE/loop-ms-${0##*/}" 2>/dev/null || echo 20 ;;
    -V) echo "Python 3.12.1" ;;
    *"-m venv"*) echo "${@: 2:$# - 2}" | sed 's/-m //' >>"$MACHINE/log"
        dir=${@: -1}; rm -rf "$dir"; mkdir -p "$dir/bin"; cp "$0" "$dir/bin/python" ;;
    *"import pip"*) [[ -e ${0%/*}/pip ]] ;;
    *"-m pip"*--version) [[ ! -e $MACHINE/no-pip ]] ;;
    *"-m pip"*"config list") cat "$MACHINE/pip-settings" 2>/dev/null ;;
    *"-m pip"*) echo "pip $*" >>"$MACHINE/log"
        [[ ! -e $MACHINE/kill-pip ]] || kill -KILL "$PPID"
        [[ ! -e $MACHINE/fail-pip ]] || { echo "no network"; exit 1; }
        if [[ $* == *requirements-setup.lock ]]; then
            [[ ! -e $MACHINE/no-uv ]] || { echo "no uv"; exit 1; }
            cp "$MACHINE/uv" "$MACHINE/metamerlab/.venv/bin/uv"
            touch "$MACHINE/metamerlab/.venv/bin/pip"
        fi ;;
    *ensurepip*) [[ ! -e $MACHINE/no-venv ]] ;;
    *sys.version_info*) echo python3.12-venv ;;
    *ctypes*) exit 1 ;;
esac
"""


class Machine:
    """A made-up machine: a PATH of fakes, and a repository with our lib.sh."""

    def __init__(self, root: Path, repository: Path) -> None:
        self.root = root
        self.bin = root / "bin"
        self.home = root / "metamerlab"
        self.bin.mkdir()
        (self.home / "script").mkdir(parents=True)
        for name in ("lib.sh", "setup"):
            shutil.copy(repository / "script" / name, self.home / "script" / name)
        for name in ("requirements", "requirements-test", "requirements-setup"):
            lock = "numpy==2 \\\n    --hash=sha256:0\n"
            (self.home / f"{name}.lock").write_text(lock)
        (root / "uv").write_text(FAKE_UV)
        (root / "uv").chmod(0o755)
        for extra in ("metrics", "metamers", "docs"):
            (self.home / f"requirements-{extra}.txt").write_text("torch==2\n")
            if extra != "docs":
                (self.home / f"requirements-{extra}.lock").write_text(
                    "lpips==1 \\\n    --hash=sha256:1\n"
                )
        (self.home / "pyproject.toml").write_text("[project]\n")
        web = self.home / "study_app/web"
        web.mkdir(parents=True)
        (web / "package-lock.json").write_text("{}\n")
        for name in TOOLS:
            if found := shutil.which(name):
                (self.bin / name).symlink_to(found)
        self.fake("python3", FAKE_PYTHON)
        self.fake("node", "#!/bin/bash\n[[ ! -e $MACHINE/old-node ]]\n")
        self.fake(
            "npm", f'#!/bin/bash\necho "npm $1" >>"$MACHINE/log"; mkdir -p {web}/node_modules\n'
        )

    def fake(self, name: str, text: str) -> None:
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def debian(self, *, missing: str = "", root: bool = True) -> None:
        """Make it a Debian on which all packages but the `missing` are installed."""
        self.fake(
            "dpkg-query",
            '#!/bin/bash\nfor name in "${@:3}"; do\n'
            f'  [[ " {missing} " == *" $name "* ]] || echo "installed $name"\ndone\n',
        )
        for name in ("apt-get", "dpkg", "sudo"):
            log = f'echo "{name} $* frontend=$DEBIAN_FRONTEND" >>"$MACHINE/log"'
            self.fake(name, f"#!/bin/bash\n{log}\n[[ {name} != sudo ]]\n")
        self.fake("id", f"#!/bin/bash\necho {0 if root else 1000}\n")

    def setup(self, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.bin / "bash", self.home / "script/setup", *arguments],
            env={
                "PATH": str(self.bin),
                "MACHINE": str(self.root),
                "TMPDIR": str(self.root),
                "SYSTEM_PYTHON": "/nowhere/python3",
                **env,
            },
            capture_output=True,
            text=True,
            timeout=60,
        )

    def log(self) -> list[str]:
        """Return what the fakes were asked since the last look."""
        path = self.root / "log"
        lines = path.read_text().splitlines() if path.exists() else []
        path.unlink(missing_ok=True)
        return lines


@pytest.fixture
def machine(tmp_path, repository):
    made = Machine(tmp_path, repository)
    made.debian()
    return made


def test_a_fresh_machine_is_set_up_and_then_left_alone(machine):
    first = machine.setup()
    assert first.returncode == 0, first.stderr
    made, tools, packages, own = machine.log()
    assert made == "venv --clear --without-pip"
    for asked in (tools, packages):
        assert "--require-hashes --only-binary :all: -r" in asked
    assert tools.endswith(f"{machine.home}/requirements-setup.lock")
    assert packages.startswith("uv ")
    assert f"-r {machine.home}/requirements.lock " in packages
    assert own.startswith("uv ")
    assert f"--no-build-isolation --editable {machine.home} " in own

    second = machine.setup()

    assert (second.returncode, second.stdout, second.stderr) == (0, "", "")
    assert machine.log() == []


def test_what_tests_need_comes_beside_it_and_stays_wanted(machine):
    machine.debian(missing="xvfb")
    assert machine.setup().returncode == 0
    assert not any(line.startswith("apt-get") for line in machine.log())

    assert machine.setup("--test").returncode == 0
    log = machine.log()
    assert any(" xvfb " in line for line in log if line.startswith("apt-get"))
    assert f"-r {machine.home}/requirements-test.lock " in log[-1]
    machine.debian()
    assert (machine.setup().stderr, machine.log()) == ("", [])


@pytest.mark.parametrize("accident", ["no-uv", "fail-uv"])
def test_pip_takes_the_place_of_uv(machine, accident):
    (machine.root / accident).touch()

    done = machine.setup()

    assert done.returncode == 0, done.stderr
    asked = [line for line in machine.log() if line.startswith("pip")]
    assert any(line.endswith(f"-r {machine.home}/requirements.lock") for line in asked)
    assert asked[-1].endswith(f"--editable {machine.home}")
    assert "pip" in done.stderr
    assert machine.setup().stderr == ""


def test_uv_asks_where_the_users_pip_asks(machine):
    (machine.root / "pip-settings").write_text(
        "global.index-url='https://lab.example/simple'\nglobal.cert='/etc/lab.pem'\n"
        ":env:.cert='/etc/mine.pem'\ninstall.find-links='/opt/wheels'\n"
        "global.find-links='/elsewhere'\nglobal.extra-index-url='https://a.example https://b.example'\n"
    )
    machine.setup()

    for line in machine.log()[2:]:
        assert line.endswith(
            "index=https://lab.example/simple also=https://a.example https://b.example"
            " links=/opt/wheels cert=/etc/mine.pem"
        )


def test_the_fastest_python_is_taken_and_named(machine):
    machine.fake("python3.13", FAKE_PYTHON.replace("3.12.1", "3.13.0"))
    for name, ms in (("python3", "52"), ("python3.13", "31")):
        (machine.root / f"loop-ms-{name}").write_text(ms)

    assert f"Python 3.13.0 ({machine.bin}/python3.13)" in machine.setup().stderr


def test_a_python_that_is_hardly_faster_does_not_replace_the_users_own(machine):
    machine.fake("python3.13", FAKE_PYTHON.replace("3.12.1", "3.13.0"))
    for name, ms in (("python3", "37"), ("python3.13", "31")):
        (machine.root / f"loop-ms-{name}").write_text(ms)

    assert f"Python 3.12.1 ({machine.bin}/python3)" in machine.setup().stderr


@pytest.mark.parametrize("name", ["requirements.lock", "pyproject.toml"])
def test_a_changed_lock_or_project_is_installed_into_the_same_environment(machine, name):
    machine.setup()
    machine.log()
    (machine.home / name).write_text("changed\n")

    assert machine.setup().returncode == 0
    assert [line.split()[0] for line in machine.log()] == ["uv", "uv"]


@pytest.mark.parametrize(
    ("extra", "arguments", "env"),
    [
        ("metrics", ["--metrics"], {}),
        ("metrics", [], {"CI": "true"}),
        ("metamers", ["--metamers"], {}),
    ],
)
def test_extras_come_when_asked_for_and_stay_wanted(machine, extra, arguments, env):
    assert machine.setup().returncode == 0
    machine.log()

    assert machine.setup(*arguments, **env).returncode == 0
    log = machine.log()
    assert log.count("npm ci") == ("CI" in env)  # beside pip
    lines = [line for line in log if line.startswith("uv")]
    (hashed,) = (line for line in lines if f"/requirements-{extra}.lock" in line)
    assert "--require-hashes --no-deps" in hashed
    (asked,) = (line for line in lines if f"/requirements-{extra}.txt" in line)
    assert "--constraint" in asked
    others = {"requirements-docs.txt", "requirements-test.lock"} if "CI" in env else set()
    assert {name for name in others if any(f"/{name} " in line for line in lines)} == others
    assert len(lines) == 2 + len(others)
    assert (machine.home / ".venv/metamerlab-locked.txt").read_text() == "numpy==2\n"
    assert (machine.setup().stderr, machine.log()) == ("", [])

    for ending in ("txt", "lock"):
        (machine.home / f"requirements-{extra}.{ending}").write_text("torch==3\n")
        assert machine.setup().returncode == 0
        assert len(machine.log()) == 2


def test_all_of_an_extra_but_torch_is_held_to_hashes(repository):
    """Else whoever answers for an index decides what runs here."""
    own = {"metrics": {"torch", "torchvision"}, "metamers": {"torch"}}
    for extra, builds in own.items():
        plain = repository / f"requirements-{extra}.txt"
        lines = plain.read_text().splitlines() if builds else []
        assert {line.partition("==")[0] for line in lines if not line.startswith("#")} == builds
        assert plain.exists() == bool(builds)
        text = (repository / f"requirements-{extra}.lock").read_text().replace("\\\n", "")
        held = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
        assert len(held) >= 2
        assert all("==" in line and "--hash=sha256:" in line for line in held)


def test_the_extra_docs_stays_wanted_and_is_held_to_its_hashes(machine):
    machine.setup()
    machine.log()
    (machine.home / ".venv/metamerlab-docs").touch()  # as script/docs leaves it

    assert machine.setup().returncode == 0
    (asked,) = machine.log()
    assert "--require-hashes" in asked
    assert "requirements-docs.txt " in asked
    assert (machine.setup().stderr, machine.log()) == ("", [])
    (machine.home / ".venv/bin/python").unlink()
    assert machine.setup().returncode == 0
    assert "requirements-docs.txt " in machine.log()[-1]


@pytest.mark.parametrize("extra", ["metrics", "metamers"])
def test_extras_survive_a_new_environment(machine, extra):
    machine.setup(f"--{extra}")
    machine.log()
    (machine.home / ".venv/bin/python").unlink()

    assert machine.setup().returncode == 0
    assert f"/requirements-{extra}.txt " in machine.log()[-1]


def test_tools_come_when_asked_for_and_with_each_new_lock(machine):
    machine.debian(missing="r-cran-lme4 firefox-esr")
    machine.fake("firefox", "#!/bin/bash\n")
    assert machine.setup().returncode == 0
    assert not any(line.startswith(("apt-get", "npm")) for line in machine.log())

    assert machine.setup("--tools").returncode == 0
    asked = machine.log()
    assert [line for line in asked if line.startswith("npm")] == ["npm ci"]
    (installed,) = (line for line in asked if " install " in line and line.startswith("apt-get"))
    assert "r-cran-lme4" in installed
    assert "firefox-esr" not in installed  # another Firefox is there
    machine.debian()
    assert (machine.setup().stderr, machine.log()) == ("", [])

    (machine.home / "study_app/web/package-lock.json").write_text("{ }\n")
    assert machine.setup().returncode == 0
    assert machine.log() == ["npm ci"]


def test_tools_need_a_new_node(machine):
    (machine.root / "old-node").touch()

    done = machine.setup("--tools")

    assert done.returncode == 2
    assert "the web part needs Node 20.19 or newer" in done.stderr


def test_setup_refuses_what_it_does_not_know(machine):
    done = machine.setup("--metric")

    assert (done.returncode, machine.log()) == (2, [])
    assert "--metamers or --tools (got --metric)" in done.stderr


@pytest.mark.parametrize("accident", ["kill-pip", "fail-pip"])
def test_an_interrupted_set_up_is_made_again(machine, accident):
    (machine.root / accident).touch()
    assert machine.setup().returncode != 0
    assert not (machine.home / ".venv/metamerlab-stamp").exists()
    machine.log()
    (machine.root / accident).unlink()

    assert machine.setup().returncode == 0
    assert machine.log()[0].startswith("venv")
    assert machine.setup().stderr == ""


def test_a_failing_pip_is_shown(machine):
    (machine.root / "fail-pip").touch()

    assert "no network" in machine.setup().stderr


def test_a_moved_repository_is_set_up_again(machine):
    machine.setup()
    machine.log()
    machine.home = machine.home.rename(machine.root / "elsewhere")

    assert machine.setup().returncode == 0
    assert f"--editable {machine.home} " in machine.log()[-1]


def test_an_environment_whose_python_is_gone_is_made_again(machine):
    machine.setup()
    machine.log()
    (machine.home / ".venv/bin/python").unlink()

    assert machine.setup().returncode == 0
    assert machine.log()[0].startswith("venv")


def test_only_missing_packages_are_installed_and_nothing_is_asked(machine):
    machine.debian(missing="xvfb libegl1")

    assert machine.setup("--test").returncode == 0
    system = [line for line in machine.log() if line.startswith(("apt-get", "dpkg", "sudo"))]
    assert [line.partition(" -o ")[0].split()[0] for line in system] == ["dpkg", *["apt-get"] * 2]
    assert " update " in system[1]
    assert "install --yes --no-install-recommends libegl1 xvfb " in system[2]
    assert all(line.endswith("frontend=noninteractive") for line in system)


def test_a_python_without_venv_gets_its_own_package(machine):
    for name in ("no-venv", "no-pip"):
        (machine.root / name).touch()

    machine.setup()

    assert any("install" in line and " python3.12-venv " in line for line in machine.log())


def test_without_root_the_missing_packages_are_named_and_nothing_is_done(machine):
    machine.debian(missing="xvfb libegl1", root=False)

    done = machine.setup("--test")

    assert done.returncode == 2
    assert "sudo apt-get install --yes --no-install-recommends libegl1 xvfb\n" in done.stderr
    assert [line.split()[0] for line in machine.log()] == ["sudo"]  # asked once, refused
    assert not (machine.home / ".venv").exists()


def test_another_system_is_told_what_is_missing(machine):
    (machine.bin / "apt-get").unlink()
    for name in ("Xvfb", "xauth", "openbox"):
        machine.fake(name, "#!/bin/bash\n")

    done = machine.setup("--test")

    assert done.returncode == 2
    assert "the command xdotool (Debian: xdotool)" in done.stderr
    assert "the library libEGL.so.1 (Debian: libegl1)" in done.stderr
    assert "Xvfb" not in done.stderr


def test_a_python_that_is_too_old_is_refused_with_one_message(machine):
    (machine.root / "too-old").write_text("1")

    done = machine.setup()

    assert done.returncode == 2
    assert done.stderr.startswith("metamerlab needs Python 3.11 or newer (found Python 3.12.1 at")
    assert machine.log() == []


def test_a_newer_python_beside_an_old_one_is_found(machine):
    machine.fake("python3.13", FAKE_PYTHON)
    machine.fake("python3", '#!/bin/bash\n[[ $1 == -V ]] && echo "Python 3.9.2"\nexit 1\n')

    assert machine.setup().returncode == 0


def test_another_python_that_is_named_replaces_the_environment(machine):
    machine.setup()
    machine.log()
    machine.fake("python3.13", FAKE_PYTHON.replace("Python 3.12.1", "Python 3.13.0"))

    assert machine.setup(PYTHON="python3.13").returncode == 0
    assert machine.log()[0].startswith("venv")
    assert machine.setup(PYTHON="python3.13").stderr == ""


@pytest.mark.parametrize("named", ["nowhere/python", "old"])
def test_a_named_python_is_taken_or_refused_but_never_replaced(machine, named):
    machine.fake("old", '#!/bin/bash\n[[ $1 == -V ]] && echo "Python 3.9.2"\nexit 1\n')

    done = machine.setup(PYTHON=named)

    assert done.returncode == 2
    assert f"PYTHON={named}" in done.stderr
    assert machine.log() == []


def test_settings_that_install_elsewhere_are_left_aside(machine):
    machine.fake(
        "python3",
        FAKE_PYTHON.replace('echo "pip $*"', 'echo "pip $* user=$PIP_USER target=$PIP_TARGET"'),
    )

    machine.setup(PIP_USER="1", PIP_TARGET="elsewhere")

    assert all(line.endswith("user= target=") for line in machine.log() if line[:3] == "pip")


@pytest.mark.parametrize("name", ["setup", "demo", "test", "check", "bench", "lock", "attack"])
def test_every_command_sets_up_first(repository, name):
    text = (repository / "script" / name).read_text(encoding="utf-8")

    assert "\nprepare\n" in text or "\nprepare tests\n" in text
    assert os.access(repository / "script" / name, os.X_OK)
