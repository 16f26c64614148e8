"""Places of a cluster: certificates, and addresses where something else listens."""

import shutil
import socket
import subprocess
import threading
import time
import warnings

import forked
import pytest
from command_line import metamerlab

import stimuli.batch.executors
from protocols.errors import StudyError
from stimuli.batch.executors import dask_cluster

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Two certificates that sign themselves, `lab` and `other`, as Dask's options name them."""
    if shutil.which("openssl") is None:
        pytest.skip("needs the command openssl (apt-get install openssl)")
    folder, made = tmp_path_factory.mktemp("certificates"), {}
    for name in ("lab", "other"):
        cert, key = folder / f"{name}.pem", folder / f"{name}-key.pem"
        subprocess.run(
            ["openssl", "req", "-x509", "-nodes", "-days", "2", "-subj", f"/CN={name}",
             "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
             "-keyout", key, "-out", cert],
            check=True, capture_output=True,
        )  # fmt: skip
        made[name] = {"tls_ca_file": cert, "tls_client_cert": cert, "tls_client_key": key}
    return {
        name: {option: str(path) for option, path in files.items()} for name, files in made.items()
    }


def cluster_of(certificates, **words):
    """A cluster on loopback that shows the lab's certificate and asks for it."""
    lab = certificates["lab"]
    files = {
        f"tls_{who}_{what}": lab[f"tls_client_{what}"]
        for who in ("scheduler", "worker", "client")
        for what in ("cert", "key")
    }
    return distributed.LocalCluster(
        threads_per_worker=1, dashboard_address=None, silence_logs=50, protocol="tls://",
        host="127.0.0.1", security=distributed.Security(tls_ca_file=lab["tls_ca_file"], **files),
        **words,
    )  # fmt: skip


@pytest.fixture(scope="module")
def guarded(certificates):
    """Address of a scheduler with certificates, without workers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with cluster_of(certificates, n_workers=0, processes=False) as cluster:
            yield cluster.scheduler_address


@pytest.mark.slow
def test_a_build_over_tls_is_the_build_made_here(
    small_study, read_plan, inline, certificates, tmp_path
):
    from stimuli.batch.build import build

    build(read_plan(small_study), tmp_path / "here", inline)
    lab = certificates["lab"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with cluster_of(certificates, n_workers=1, processes=True) as cluster:
            metamerlab(
                "stimuli",
                "build",
                str(small_study),
                "--out",
                str(tmp_path / "far"),
                "--scheduler",
                cluster.scheduler_address,
                "--tls-ca-file",
                lab["tls_ca_file"],
                "--tls-cert",
                lab["tls_client_cert"],
                "--tls-key",
                lab["tls_client_key"],
            )
    here, far = (
        {file.relative_to(tmp_path / name): file.read_bytes() for file in files}
        for name in ("here", "far")
        for files in [sorted((tmp_path / name).rglob("*.png"))]
    )
    assert far != {}
    assert {path: far[path] for path in far} == here


@pytest.mark.parametrize(
    ("scheme", "who", "reason"),
    [
        ("tls", "lab", "the cluster must have workers"),  # so the certificates were taken
        ("tls", "other", "certificate verify failed"),
        ("tls", None, "ssl_context"),
        ("tcp", None, "must be the address of a running Dask scheduler"),
        ("tcp", "lab", "encryption required"),
    ],
)
def test_certificates_open_a_scheduler_and_others_are_told(
    guarded, certificates, scheme, who, reason
):
    address = guarded.replace("tls", scheme)
    with (
        pytest.raises(StudyError, match=f"(?s){address}.*{reason}"),
        dask_cluster(address, certificates[who] if who else {}),
    ):
        pass


def test_dasks_own_configuration_names_the_certificates(guarded, certificates):
    import dask

    lab = certificates["lab"]
    client = {"cert": lab["tls_client_cert"], "key": lab["tls_client_key"]}
    tls = {"distributed.comm.tls.ca-file": lab["tls_ca_file"],
           "distributed.comm.tls.client": client}  # fmt: skip
    with (
        dask.config.set(tls),
        pytest.raises(StudyError, match="must have workers"),
        dask_cluster(guarded),
    ):
        pass


@pytest.fixture
def listening():
    """A place where something listens that is no scheduler; what it says can be given."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        taken, answers = [], [b""]

        def answer():
            while True:
                try:
                    taken.append(server.accept()[0])
                except OSError:
                    return
                taken[-1].sendall(answers[0])

        threading.Thread(target=answer, daemon=True).start()
        yield server.getsockname()[1], answers
        server.shutdown(socket.SHUT_RDWR)
        for one in taken:
            one.close()


@pytest.mark.parametrize("scheme", ["tcp", "tls"])
@pytest.mark.parametrize("said", [b"", b"SSH-2.0-OpenSSH_9.9\r\n"])
def test_what_is_no_scheduler_is_told_and_not_waited_for(
    listening, small_study, certificates, tmp_path, scheme, said
):
    """The command as a whole: distributed would hang, or hold it for 20 s when all is said."""
    port, answers = listening
    answers[0] = said
    lab = certificates["lab"] if scheme == "tls" else {}
    options = ("--tls-ca-file", "--tls-cert", "--tls-key")
    done = forked.run(
        "stimuli", "build", small_study, "--out", tmp_path / "clips",
        "--scheduler", f"{scheme}://127.0.0.1:{port}",
        *(word for pair in zip(options, lab.values(), strict=False) for word in pair),
        code=f"from stimuli.batch import executors; executors.CONNECT_S = 0.3; {forked.METAMERLAB}",
        timeout=60,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "must be the address of a running Dask scheduler" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "clips").exists()


@pytest.mark.parametrize(
    "address",
    ["", "8786", "localhost", "tcp://", "tcp://localhost", "tcp://localhost:port", "tcp://[::1",
     "http://localhost:8787", "processes", "inproc://x", "x y", "tls://localhost:1"],
)  # fmt: skip
def test_an_address_that_is_none_is_told(address, monkeypatch):
    monkeypatch.setattr(stimuli.batch.executors, "CONNECT_S", 0.3)
    with (
        pytest.raises(StudyError, match="must be the address of a running Dask scheduler"),
        dask_cluster(address),
    ):
        pass


def test_a_cluster_that_is_lost_is_told():
    """As when its scheduler is killed: what was handed in is cancelled."""

    def lost(address):
        with dask_cluster(address) as (executor, _):
            handed_in = executor.submit(time.sleep, 0.1)
            handed_in.cancel()
            handed_in.result()

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            distributed.LocalCluster(
                n_workers=1, processes=False, dashboard_address=None, silence_logs=50
            ) as cluster,
            pytest.raises(StudyError, match=r"was lost.*run the same command again"),
        ):
            lost(cluster.scheduler_address)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--tls-key", "{here}"), "--tls-key: must come with --scheduler tls://HOST:PORT"),
        (
            ("--scheduler", "tls://127.0.0.1:1", "--tls-cert", "none.pem"),
            "--tls-cert: must be a file, PEM (got none.pem)",
        ),
    ],
)
def test_certificates_that_cannot_be_used_are_told(small_study, tmp_path, words, said):
    done = metamerlab("stimuli", "build", str(small_study), "--out", str(tmp_path / "clips"),
         *(word.format(here=__file__) for word in words), status=2)  # fmt: skip
    assert said in " ".join(done.stderr.split())
    assert not (tmp_path / "clips").exists()


def test_the_help_says_who_reaches_a_scheduler():
    said = " ".join(metamerlab("stimuli", "build", "--help", status=None).output.split())
    for part in ("--host", "--tls-ca-file", "tls://HOST:PORT", "network that you trust"):
        assert part in said
