"""Models that call home."""

import socket
import sys

from told import model, refused, together


def _try_tcp(told):
    socket.create_connection(("127.0.0.1", told["port"]), 1).close()


def _try_udp(told):
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", told["port"]))


def _try_unix_socket(told):
    socket.socket(socket.AF_UNIX).connect(told["socket"])


def _try_abstract_socket(told):
    socket.socket(socket.AF_UNIX).connect("\0" + told["abstract"])


def _try_socket_pair(told):
    socket.socketpair()  # allowed: it reaches nobody else
    refused("a pair reaches only itself")


tcp = model(_try_tcp)
udp = model(_try_udp)
unix_socket = model(_try_unix_socket)
abstract_socket = model(_try_abstract_socket)
socket_pair = model(_try_socket_pair)
everything = together(sys.modules[__name__])
