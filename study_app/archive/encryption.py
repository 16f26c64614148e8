"""Encryption of archives by age (https://age-encryption.org), which any program of age can undo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

from protocols.disk.read_file import decode_utf8, read_bytes
from protocols.errors import StudyError
from protocols.limits import limit

MAGIC = b"age-encryption.org/v1\n"
_BY_PASSPHRASE = MAGIC + b"-> scrypt "


def _pyrage() -> Any:
    try:
        import pyrage
    except ImportError:
        raise StudyError(
            "encrypted archives need the package pyrage (it is not installed); install it with: pip"
            " install 'metamerlab[age]'"
        ) from None
    return pyrage


def seal(
    plain: IO[bytes],
    out: IO[bytes],
    *,
    recipients: Sequence[str] = (),
    passphrase: str | None = None,
) -> None:
    """Encrypt a file from where it stands, to public keys or by a passphrase.

    Parameters
    ----------
    recipients : sequence of str
        ``age1...``, as age-keygen prints them.
    passphrase : str, optional
        In their place. The whole file is in memory then.

    Raises
    ------
    StudyError
        If pyrage is not installed, or a recipient is none.
    """
    pyrage = _pyrage()
    if passphrase is not None:
        out.write(pyrage.passphrase.encrypt(plain.read(), passphrase))
        return
    keys = []
    for text in recipients:
        try:
            keys.append(pyrage.x25519.Recipient.from_str(text))
        except pyrage.RecipientError:
            raise StudyError(
                f"--recipient: must be a public key of age, age1... (got {text!r}); age-keygen"
                " makes one"
            ) from None
    pyrage.encrypt_io(plain, out, keys)


def is_sealed(file: IO[bytes]) -> bool:
    """Return True if a file is encrypted; it stands at its beginning before and after."""
    head = file.read(len(MAGIC))
    file.seek(0)
    return head == MAGIC


def unseal(
    path: Path, sealed: IO[bytes], plain: IO[bytes], *, identity: Path | None,
    ask: Callable[[], str],
) -> None:  # fmt: skip
    """Decrypt a file.

    Parameters
    ----------
    path : Path
        For messages.
    identity : Path, optional
        A file of age-keygen with the secret key.
    ask : callable
        Gives the passphrase, where the file has one.

    Raises
    ------
    StudyError
        If key or passphrase do not open it, or it is damaged.
    """
    head = sealed.read(len(_BY_PASSPHRASE))
    sealed.seek(0)
    pyrage = _pyrage()
    try:
        if head == _BY_PASSPHRASE:
            if path.stat().st_size > (most := limit("unpacked")):
                raise StudyError(
                    f"{path}: must have at most {most:,} bytes to be opened by a passphrase here;"
                    " decrypt it with 'age --decrypt'"
                )
            plain.write(pyrage.passphrase.decrypt(sealed.read(), ask()))
        else:
            pyrage.decrypt_io(sealed, plain, _identities(path, identity))
    except (pyrage.DecryptError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise  # the disk's own
        said = str(error).splitlines()[0]
        raise StudyError(
            f"{path}: must open with this key or passphrase, and be whole ({said})"
        ) from None
    plain.seek(0)


def _identities(path: Path, identity: Path | None) -> list[Any]:
    if identity is None:
        raise StudyError(f"{path}: is encrypted to a key; name its file with --identity")
    pyrage = _pyrage()
    text = decode_utf8(read_bytes(identity, "the file of secret keys"), identity)
    lines = [line.strip() for line in text.splitlines()]
    try:
        keys = [pyrage.x25519.Identity.from_str(line) for line in lines if line and line[0] != "#"]
    except pyrage.IdentityError:
        keys = []
    if not keys:
        raise StudyError(
            f"{identity}: must hold secret keys of age, AGE-SECRET-KEY-1..., as age-keygen writes"
            " them"
        )
    return keys
