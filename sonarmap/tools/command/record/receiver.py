"""Reception of packets: a socket, and a thread that does nothing but move its datagrams to memory."""

import errno
import queue
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from ipaddress import AddressValueError, IPv4Address

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.rows import shown
from sonarmap.tools.files.readers.sonar.packets import MAGICS, fault_of

MOST_WAITING = 2048  # datagrams in memory, 134 MB at most; half a minute or more of a sonar's packets
_LARGEST = 1 << 16  # bytes of a datagram; UDP allows fewer
_PAUSE = 0.1  # longest delay until a requested end is noticed [s]
_GONE = 10.0  # silence after which a sonar at another address is taken for the recorded one, restarted [s]
_NAMED = 8  # addresses of other sonars that are listed


@dataclass(frozen=True, slots=True)
class Datagram:
    """A received datagram: its bytes, its sender's address, and its arrival by this computer's clock [s, UTC]."""

    content: bytes
    sender: str
    arrival: float


class Receiver:
    """Receives datagrams while it is open as a context; then `rest` also returns those in the system's buffer."""

    def __init__(self, listening: socket.socket) -> None:
        self.unsaved = self.overflow = 0  # datagrams lost as too many waited, or as the system's buffer was full
        self._socket = listening
        self._waiting: queue.Queue[Datagram] = queue.Queue(MOST_WAITING)
        self._ends = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="receiver", daemon=True)

    def __enter__(self) -> "Receiver":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def next(self, timeout: float) -> Datagram | None:
        """The next datagram, or None if none came within `timeout` [s]."""
        try:
            return self._waiting.get(timeout=timeout)
        except queue.Empty:
            if self._error is not None:
                raise InputError(f"receiving ended: {self._error}; look at the network") from self._error
            return None

    def end(self) -> None:
        """Stop receiving."""
        self._ends.set()
        self._thread.join()

    def rest(self) -> Iterator[Datagram]:
        """After the end, the datagrams that `next` has not returned."""
        while not self._waiting.empty():
            yield self._waiting.get_nowait()

    def _run(self) -> None:
        self._socket.settimeout(_PAUSE)
        try:
            while not self._ends.is_set():
                self._receive()
            self._socket.setblocking(False)
            for _ in range(MOST_WAITING):  # at most, as the stream may not end
                if not self._receive():
                    break
        except Exception as error:  # noqa: BLE001 - `next` raises it
            self._error = error

    def _receive(self) -> bool:
        """Receive one datagram; whether there was one."""
        try:
            content, ancillary, _, (sender, _) = self._socket.recvmsg(_LARGEST, socket.CMSG_SPACE(4))
        except (TimeoutError, BlockingIOError):
            return False
        self.overflow = overflow_of(ancillary) or self.overflow
        try:
            self._waiting.put_nowait(Datagram(content, sender, time.time()))
        except queue.Full:
            self.unsaved += 1
        return True


@dataclass(slots=True)
class Senders:
    """Selects the packets of one sonar: that of the wanted address, or the first that sends."""

    wanted: str | None = None  # address of the sonar to record; None for the first that sends
    sonar: str | None = None  # address of the sonar that is recorded; None until it is known
    moves: int = 0  # number of times that another address took its place
    damaged: int = 0  # packets of the sonar with a wrong length or checksum
    first_damage: str = ""  # fault of the first of them, in words
    foreign: int = 0  # datagrams that are not packets of a sonar
    first_foreign: str = ""  # sender and beginning of the first of them, in words
    others: int = 0  # whole packets of other sonars, which are not recorded
    addresses: list[str] = field(default_factory=list)  # of these sonars, the first `_NAMED`
    _latest: float = 0.0

    def is_wanted(self, datagram: Datagram, now: float) -> bool:
        """Whether a datagram is a whole packet of the recorded sonar; counts it if not. `now` is the time of a
        monotonic clock [s]."""
        content, sender = datagram.content, datagram.sender
        is_packet = content[:4] in MAGICS
        if not is_packet and sender != self.sonar:
            self.foreign += 1
            self.first_foreign = self.first_foreign or f"from {sender}, beginning with {shown(content[:16])}"
            return False
        fault = fault_of(content) if is_packet else f"begins with {shown(content[:8])}"
        if fault and sender == (self.sonar or self.wanted or sender):
            self.damaged += 1
            self.first_damage = self.first_damage or fault
            return False
        if fault or not self._is_recorded(sender, now):
            self._count_other(sender)
            return False
        self.sonar, self._latest = sender, now
        return True

    def _is_recorded(self, sender: str, now: float) -> bool:
        if self.wanted is not None:
            return sender == self.wanted
        if self.sonar in (None, sender):
            return True
        is_gone = now - self._latest > _GONE
        self.moves += is_gone
        return is_gone

    def _count_other(self, sender: str) -> None:
        self.others += 1
        if sender not in self.addresses and len(self.addresses) < _NAMED:
            self.addresses.append(sender)


GROUP = "224.0.0.96:4747"  # where the sonar sends by default
WANTED_BUFFER = 16 << 20  # bytes; the system may grant less
_MULTICAST_ALL = 49  # IP_MULTICAST_ALL of Linux, which Python has no name for
_OVERFLOW = 40  # SO_RXQ_OVFL of Linux: how many datagrams did not fit the buffer


@dataclass(frozen=True, slots=True)
class Source:
    """Where packets are received."""

    address: IPv4Address  # a multicast group, or an address of this computer; 0.0.0.0 for all of them
    port: int  # of UDP
    # name or address of the interface that joins the group; None for all interfaces
    interface: str | None = None

    @property
    def words(self) -> str:
        """For example "224.0.0.96:4747 on eth0"."""
        place = f"{self.address}:{self.port}"
        return f"{place} on {self.interface or 'every interface'}" if self.address.is_multicast else place


def source_of(multicast: str | None, unicast: str | None, interface: str | None) -> Source:
    """The source that the options give: a multicast GROUP:PORT at an interface, or a unicast ADDRESS:PORT of this
    computer; by default the sonar's default group."""
    if unicast is None:
        return Source(*_endpoint(GROUP if multicast is None else multicast, "--multicast", GROUP), interface)
    if multicast is not None or interface is not None:
        other = "--multicast" if multicast is not None else "--interface"
        raise InputError(f"{other} has no effect with --unicast, which says where to listen; leave one out")
    return Source(*_endpoint(unicast, "--unicast", "192.168.194.90:4747"))


def _endpoint(text: str, option: str, example: str) -> tuple[IPv4Address, int]:
    """Address and port in ADDRESS:PORT; host names are not resolved."""
    wants_group = option == "--multicast"
    place, _, number = text.rpartition(":")
    try:
        address, port = IPv4Address(place), int(number)
        if not 0 < port < 1 << 16:
            raise ValueError
    except ValueError as error:
        wanted = f"wanted an IPv4 address in numbers and a port from 1 to 65535, as in {option} {example}"
        raise InputError(f"{option} is {text!r}; {wanted}") from error
    if wants_group and not address.is_multicast:
        raise InputError(
            f"{option} is {text!r}; wanted a group of 224.0.0.0 to 239.255.255.255; for another give --unicast"
        )
    if address.is_multicast and not wants_group:
        raise InputError(f"{option} is {text!r}, a multicast group; give --multicast {text}")
    return address, port


def open_socket(source: Source) -> socket.socket:
    """A socket that listens at the source, with the largest receive buffer that the system grants; it sends nothing."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_UDP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WANTED_BUFFER)
        if source.address.is_multicast:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the sonar's viewer may listen too
        if sys.platform == "linux":
            listening.setsockopt(socket.SOL_SOCKET, _OVERFLOW, 1)
            listening.setsockopt(socket.IPPROTO_IP, _MULTICAST_ALL, 0)  # only from interfaces that it joins itself
        listening.bind((str(source.address), source.port))
        if source.address.is_multicast and not join(listening, source):
            raise OSError(errno.ENODEV, "no such interface, or multicast is not possible there")
    except OSError as error:
        listening.close()
        raise InputError(f"cannot listen at {source.words}: {error.strerror}. {_advice(source, error)}") from error
    return listening


def _advice(source: Source, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return "Another program listens there: end it, or have the sonar send by multicast, where several can listen."
    if error.errno == errno.EACCES:
        return "Ports below 1024 need permission: set a higher one in the sonar's settings."
    names = ", ".join(name for _, name in socket.if_nameindex())
    return (
        f"The interfaces of this computer are {names}; give one of them, or its address, to --interface."
        if source.address.is_multicast
        else "Give an address of this computer in the sonar's network, or 0.0.0.0 for all that it has, to --unicast."
    )


def join(listening: socket.socket, source: Source) -> bool:
    """Join the source's group on its interfaces; whether it is joined on any. Call it again to join on interfaces that
    came up since."""
    return sum(_is_joined_at(listening, source.address, place) for place in _places(source.interface)) > 0


def _places(interface: str | None) -> list[bytes]:
    """Address and index of each interface, packed as at the end of the system's `ip_mreqn`."""
    try:
        if interface is not None:
            return [IPv4Address(interface).packed + struct.pack("@i", 0)]
    except AddressValueError:
        pass  # a name
    return [bytes(4) + struct.pack("@i", index) for index, name in socket.if_nameindex() if interface in (None, name)]


def _is_joined_at(listening: socket.socket, group: IPv4Address, place: bytes) -> bool:
    try:
        listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + place)
    except OSError as error:
        return error.errno == errno.EADDRINUSE  # joined before
    return True


def system_buffer(listening: socket.socket) -> int:
    """Size of the socket's receive buffer [bytes]; Linux includes its own overhead."""
    return listening.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def overflow_of(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """Number of datagrams that the socket has lost as its buffer was full; None if the message does not state it."""
    for level, kind, content in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _OVERFLOW):
            return struct.unpack("=I", content)[0]
    return None
