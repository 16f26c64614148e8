"""An X server asked by libxcb: requests and replies are the protocol's own bytes.

Numbers and places of bytes are those of "X Window System Protocol, version 11", appendix B, and of
the extensions' own pages.
"""

from __future__ import annotations

import ctypes
import struct
import sys


class _Vector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Request(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_size_t),
        ("extension", ctypes.c_void_p),
        ("opcode", ctypes.c_uint8),
        ("no_reply", ctypes.c_uint8),
    )


class _Screens(ctypes.Structure):
    _fields_ = (
        ("root", ctypes.POINTER(ctypes.c_uint32)),
        ("left", ctypes.c_int),
        ("index", ctypes.c_int),
    )


class XServer:
    """A connection of our own to the X server that DISPLAY names.

    Attributes
    ----------
    screen, root : int
        Number and root window of the screen that DISPLAY names.

    Raises
    ------
    OSError
        If there is no libxcb, or no such server.
    """

    def __init__(self) -> None:
        try:
            xcb, screen = ctypes.CDLL("libxcb.so.1"), ctypes.c_int()
        except OSError:
            must = "there is no libxcb; install it (Debian, Ubuntu: apt-get install libxcb1)"
            raise OSError(must) from None
        for name in ("connect", "wait_for_reply", "poll_for_event", "get_setup"):
            getattr(xcb, f"xcb_{name}").restype = ctypes.c_void_p
        xcb.xcb_setup_roots_iterator.restype = _Screens
        self._xcb, self._free = xcb, ctypes.CDLL(None).free
        self._server = ctypes.c_void_p(xcb.xcb_connect(None, ctypes.byref(screen)))
        if xcb.xcb_connection_has_error(self._server):
            self.close()
            raise OSError("no X server answers; log in to the desktop anew")
        screens = xcb.xcb_setup_roots_iterator(ctypes.c_void_p(xcb.xcb_get_setup(self._server)))
        for _ in range(screen.value):
            xcb.xcb_screen_next(ctypes.byref(screens))
        self.screen, self.root = screen.value, int(screens.root[0])

    def close(self) -> None:
        """Close the connection."""
        self._xcb.xcb_disconnect(self._server)

    def ask(self, opcode: int, detail: int, body: bytes = b"") -> bytes:
        """Return the server's reply to a request, which begins with `opcode` and `detail`.

        Empty: it has none, as for a window that is gone, or is gone itself.
        """
        reply = self._xcb.xcb_wait_for_reply(
            self._server, self._send(opcode, detail, body, no_reply=False), None
        )
        return self._taken(reply)

    def tell(self, opcode: int, detail: int, body: bytes = b"") -> None:
        """Send a request that has no reply."""
        self._send(opcode, detail, body, no_reply=True)
        self._xcb.xcb_flush(self._server)

    def _send(self, opcode: int, detail: int, body: bytes, *, no_reply: bool) -> int:
        body += bytes(-len(body) % 4)
        data = ctypes.create_string_buffer(struct.pack("=BBH", opcode, detail, 0) + body)
        vectors = (_Vector * 3)()  # libxcb fills the first two
        vectors[2] = _Vector(ctypes.addressof(data), len(body) + 4)
        request = _Request(1, None, opcode, no_reply)
        return int(
            self._xcb.xcb_send_request(
                self._server, 0, ctypes.byref(vectors, 2 * ctypes.sizeof(_Vector)),
                ctypes.byref(request),
            )
        )  # fmt: skip

    def events(self) -> list[bytes]:
        """Return the server's messages since the last call: 32 bytes for each event or error."""
        given = iter(lambda: self._xcb.xcb_poll_for_event(self._server), None)
        return [self._taken(each) for each in given]

    def _taken(self, address: int | None) -> bytes:
        if not address:
            return b""
        head = ctypes.string_at(address, 8)
        more = 4 * int.from_bytes(head[4:], sys.byteorder) if head[0] == 1 else 0
        data = ctypes.string_at(address, 32 + more)
        self._free(ctypes.c_void_p(address))
        return data

    def extension(self, name: str) -> int:
        """Return the opcode of an extension; 0: the server has it not."""
        reply = self.ask(98, 0, struct.pack("=HH", len(name), 0) + name.encode("ascii"))
        return reply[9] if reply and reply[8] else 0

    def has_compositor(self) -> bool:
        """Return True if a program puts the windows together: it owns a known selection."""
        name = f"_NET_WM_CM_S{self.screen}".encode("ascii")
        atom = self.ask(16, 0, struct.pack("=HH", len(name), 0) + name)[8:12]
        return any(self.ask(23, 0, atom)[8:12])

    def monitors(self) -> list[tuple[int, int, int, int]]:
        """Return left, top, width and height of every monitor, in pixels of the root window."""
        if not (randr := self.extension("RANDR")):
            return []
        reply, at, boxes = self.ask(randr, 42, struct.pack("=II", self.root, 1)), 32, []
        while at < len(reply):
            outputs, *box = struct.unpack_from("=HhhHH", reply, at + 6)
            boxes.append(tuple(box))
            at += 24 + 4 * outputs
        return boxes
