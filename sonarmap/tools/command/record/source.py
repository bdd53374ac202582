"""Where packets come in: a multicast group or an address of this computer, and the socket that listens there.

wlsonar opens sockets too, but binds the multicast port on all addresses and joins the group on one interface, which the
system chooses. Here a group's socket takes only what is sent to the group, on the interfaces that were asked for.
"""

import errno
import socket
import struct
import sys
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address

from sonarmap.kernels.errors import InputError

GROUP = "224.0.0.96:4747"  # where the sonar sends by default
WANTED_BUFFER = 16 << 20  # bytes; the system may grant less
_MULTICAST_ALL = 49  # IP_MULTICAST_ALL of Linux, which Python has no name for
_OVERFLOW = 40  # SO_RXQ_OVFL of Linux: how many datagrams did not fit the buffer


@dataclass(frozen=True, slots=True)
class Source:
    """Where packets are awaited."""

    address: IPv4Address  # a multicast group, or an address of this computer; 0.0.0.0 for all that it has
    port: int  # of UDP
    # a name or an address of this computer where the group is joined; None for all interfaces
    interface: str | None = None

    @property
    def words(self) -> str:
        """As in "224.0.0.96:4747 on eth0"."""
        place = f"{self.address}:{self.port}"
        return f"{place} on {self.interface or 'every interface'}" if self.address.is_multicast else place


def source_of(multicast: str | None, unicast: str | None, interface: str | None) -> Source:
    """The source that options ask for; the sonar's default group if they are None.

    GROUP:PORT of a group that is joined at the interface, or ADDRESS:PORT of this computer. Raises InputError: an
    address that is none, or options that exclude each other.
    """
    if unicast is None:
        return Source(*_endpoint(GROUP if multicast is None else multicast, "--multicast", GROUP), interface)
    if multicast is not None or interface is not None:
        other = "--multicast" if multicast is not None else "--interface"
        raise InputError(
            f"{other} has no effect with --unicast, which says itself at which address of this computer to listen; "
            "leave one of them out"
        )
    return Source(*_endpoint(unicast, "--unicast", "192.168.194.90:4747"))


def _endpoint(text: str, option: str, example: str) -> tuple[IPv4Address, int]:
    """ADDRESS:PORT, checked; a name is not looked up."""
    wants_group = option == "--multicast"
    place, _, number = text.rpartition(":")
    try:
        address = IPv4Address(place)
    except AddressValueError as error:
        raise InputError(
            f"{option} is {text!r}; wanted an IPv4 address in numbers and a port, as in {option} {example}"
        ) from error
    if not (number.isascii() and number.isdecimal() and 0 < int(number) < 1 << 16):
        raise InputError(f"{option} is {text!r}; wanted a port from 1 to 65535 behind the colon, as in {example}")
    if wants_group and not address.is_multicast:
        raise InputError(
            f"{option} is {text!r}; wanted a group from 224.0.0.0 to 239.255.255.255, as in {option} {example}. For an "
            "address of this computer give --unicast."
        )
    if address.is_multicast and not wants_group:
        raise InputError(f"{option} is {text!r}, a multicast group; give --multicast {text}")
    return address, int(number)


def open_socket(source: Source) -> socket.socket:
    """A socket that listens there, with as large a receive buffer as the system grants. It sends nothing.

    Raises InputError: this computer has no such address or interface, or the port is taken or not allowed.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_UDP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WANTED_BUFFER)
        if source.address.is_multicast:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the sonar's viewer may listen too
        if sys.platform == "linux":
            listening.setsockopt(socket.SOL_SOCKET, _OVERFLOW, 1)
            listening.setsockopt(socket.IPPROTO_IP, _MULTICAST_ALL, 0)  # nothing from where others joined the group
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
    """Join the source's group where it is not joined yet; whether it is joined anywhere then.

    Called again it joins on interfaces that came, or came back, since.
    """
    return sum(_is_joined_at(listening, source.address, place) for place in _places(source.interface)) > 0


def _places(interface: str | None) -> list[bytes]:
    """Address and index of interfaces, as the system's `ip_mreqn` ends."""
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
    """Size of the socket's receive buffer [bytes]; Linux counts its own bookkeeping in."""
    return listening.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def overflow_of(ancillary: list[tuple[int, int, bytes]]) -> int | None:
    """How many datagrams the socket has lost as its buffer was full, if a received one says so."""
    for level, kind, content in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _OVERFLOW):
            return struct.unpack("=I", content)[0]
    return None
