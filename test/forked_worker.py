"""Takes the place of a worker that is forked from another process: the worker gets this process's standard streams."""
import os
import signal
import socket
import sys


def main(path):
    """Hand the streams to the process at the other end of a socket, and wait until the worker ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)        # the worker handles it
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(path)
        socket.send_fds(server, [b'.'], [0, 1, 2])
        for number in (0, 1):       # the reader must notice when the worker closes its output
            os.close(number)
        server.recv(1)


if __name__ == '__main__':
    main(sys.argv[1])
