"""Ends a node on a signal, or when its parent process has ended. Needs no ROS."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
import time

#: Set (to anything) by a process that starts a node and holds the other end of its standard input:
#: the node ends when that is closed, however its parent ended.
LIFELINE = "MRS_ENDS_WITH_STDIN"
#: A node whose parent has ended gets this long to end in order [s].
_GRACE_S = 5.0
#: `ros2 launch` may pass on a Ctrl-C that the terminal has sent, too; a second one comes later [s].
_TWICE_S = 0.5
#: A node that has begun to leave its network has ended after this, or is ended [s].
_LEAVE_S = 10


def end_in_order() -> threading.Event:
    """Lets Ctrl-C, SIGTERM, a closed terminal and the end of the parent end a node in order.

    rclpy's own handlers shut the context down at once, also during a callback: one that publishes
    fails then ("publisher's context is invalid"), and so does a node that is starting ("cannot
    configure"). Here the callback finishes first. A second Ctrl-C ends the process at once, also
    where a callback hangs.

    Returns:
        Set when the node is to end.
    """
    stop = threading.Event()
    first_s = 0.0

    def handle(number: int, _frame: object) -> None:
        nonlocal first_s
        now_s = time.monotonic()
        if number == signal.SIGINT and first_s and now_s - first_s > _TWICE_S:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        first_s = first_s or now_s
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup
            signal.signal(number, handle)
    if os.environ.get(LIFELINE):
        threading.Thread(target=_watch_parent, args=[stop], name="lifeline", daemon=True).start()
    return stop


def end_soon() -> None:
    """Has the process ended by SIGALRM, which says where it is, if it does not end by itself.

    A middleware that hangs while a node is destroyed is not Python: no handler of ours would run.
    """
    faulthandler.register(signal.SIGALRM, file=2, chain=True)  # sys.stderr may be closed
    signal.alarm(_LEAVE_S)


def ignore_signals() -> None:
    """Ignores signals while the process exits: `ros2 launch` may send a second one."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def _watch_parent(stop: threading.Event) -> None:
    while os.read(0, 4096):
        pass
    stop.set()
    time.sleep(_GRACE_S)
    os.kill(os.getpid(), signal.SIGKILL)
