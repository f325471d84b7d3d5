"""Playback of frames in simulation time: pause, resume, reset, step, seek and speed, in any executor.

A steady timer, set to the due time of the next frame, plays it. The services are named after the node, like those of a
rosbag2 player (``/dragon/sim/pause``), so that a sim and a replay in one namespace do not collide.
"""
import time
from collections.abc import Callable
from typing import Protocol

from std_srvs.srv import Trigger

from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import NS
from dragon_ros.nodes import logs
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.pacer import Pacer

_POLL_NS = 20_000_000       # interval between checks of whether it may start
_SLICE_S = 0.005            # longest time of playback before the executor serves other callbacks
_PROGRESS_S = 1.0               # interval of progress messages


class PlaySource(Protocol):
    """A source of frames in order of simulation time, with a current position."""

    def next_ns(self) -> int | None:
        """Return the time of the next frame; None at the end."""

    def last_ns(self) -> int:
        """Return the time of the last frame."""

    def show(self) -> None:
        """Publish the next frame and advance."""

    def flush(self) -> bool:
        """Publish the messages that slow readers held back; return whether none are held back now."""

    def rewind(self) -> None:
        """Move to the first frame."""

    def seek(self, t_ns: int | None) -> None:
        """Move to the last frame at or before ``t_ns``; None: the first. Raises DragonError if there is none."""

    def place(self) -> str:
        """Return the position of the last frame shown, as text."""

    def ending(self) -> str:
        """Return the reason why there is no next frame, as text."""


class Player:
    """Plays a source on a node with the parameters ``CONTROLS``; ``done`` when it has ended for good."""

    def __init__(self, node: DragonNode, source: PlaySource, time_scale: float, ready: Callable[[], bool]) -> None:
        """Offer the services; playback starts when ``ready()`` is true."""
        self.pacer, self.paused, self.done = Pacer(time_scale), False, False
        self._node, self._source, self._ready = node, source, ready
        self._waiting, self._owed = True, 0
        self._note_place()
        self._timer = node.create_timer(0.0, self._on_timer, clock=STEADY)
        for name in ('pause', 'resume', 'reset', 'step', 'seek'):
            node.create_service(Trigger, f'~/{name}', self._service(getattr(self, name)))

    def pause(self) -> str:
        """Pause after the last frame."""
        self.paused = True
        return f'paused {self._source.place()}'

    def resume(self) -> str:
        """Resume; the next frame is due one tick from now. Raises DragonError if it holds at the end."""
        if self._source.next_ns() is None and self._node.setting['at_end'] == 'hold':
            raise DragonError(f'{self._source.ending()}: nothing follows; reset or seek first')
        self.paused = False
        self._wake()
        return f'resumed {self._source.place()}'

    def reset(self) -> str:
        """Return to the first frame and show it; time jumps back. A pause continues."""
        self._source.rewind()
        return self._show_now(1)

    def step(self) -> str:
        """Pause, then play the next ``step_ticks`` frames at once."""
        self.paused = True
        if self._source.next_ns() is None:
            raise DragonError(f'{self._source.ending()}: nothing follows; reset or seek first')
        return self._show_now(self._node.setting['step_ticks'])

    def seek(self) -> str:
        """Move to the last frame at or before ``seek_s`` (negative: the first) and show it. A pause continues."""
        seek_s = self._node.setting['seek_s']
        self._source.seek(None if seek_s < 0 else round(seek_s * NS))
        return self._show_now(1)

    def set_speed(self, time_scale: float) -> None:
        """Continue at another speed from the current time, without a jump."""
        self.pacer.scale = time_scale
        self._wake()

    def stands(self) -> bool:
        """Return whether time stands still: before the start, during a pause, at the end."""
        return self._waiting or self.paused or self.done

    def _service(self, act: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.success, response.message = True, act()
                self._note_place()
            except DragonError as error:
                response.success, response.message = False, str(error)
            return response
        return serve

    def _show_now(self, frames: int) -> str:
        """Show this many frames at once, or as soon as slow readers catch up."""
        self._owed, self.done = frames, False
        while self._owed and self._play_owed():
            pass
        self._wake()
        return self._source.place() + (f'; {self._owed} more when the readers follow' if self._owed else '')

    def _play_owed(self) -> bool:
        """Show one owed frame; return whether that was possible."""
        t_ns = self._source.next_ns()
        if t_ns is None:
            self._owed = 0
        elif self._source.flush():
            self._owed -= 1
            self.pacer.rest()
            self.pacer.start(t_ns)
            self._source.show()
        else:
            return False
        return True

    def _wake(self, delay_ns: int = 0) -> None:
        """Call the timer after ``delay_ns`` of wall time."""
        self._timer.timer_period_ns = delay_ns
        self._timer.reset()

    def _on_timer(self) -> None:
        delay_ns = self._play()
        if delay_ns is None:
            self._timer.cancel()
        else:
            self._wake(delay_ns)

    def _play(self) -> int | None:
        """Play the due frames; return the wall time until the next action, None if only a service call leads to one."""
        if self._waiting and not self._owed:
            if not self._ready():
                return _POLL_NS
            self._waiting = False
            self._node.get_logger().info(f'starts {self._source.place()}')
        until = time.monotonic() + _SLICE_S
        delay_ns: int | None = 0
        while delay_ns == 0 and time.monotonic() < until:
            delay_ns = self._play_one()
        self._log_progress()
        return delay_ns

    def _play_one(self) -> int | None:
        """Play one frame if it is due; return the same as ``_play``."""
        if not self._source.flush():
            return 0
        if self._owed:
            self._play_owed()
            return 0
        if self.paused or self.done:
            self.pacer.rest()
            return None
        t_ns = self._source.next_ns()
        if t_ns is None:
            return self._end()
        if delay_ns := self.pacer.delay_ns(t_ns):
            return delay_ns
        self.pacer.start(t_ns)
        self._source.show()
        return 0

    def _end(self) -> int | None:
        """Act at the end according to ``at_end``; return the same as ``_play``."""
        at_end = self._node.setting['at_end']
        if at_end == 'loop':
            self._source.rewind()
            self.pacer.rest()
            return 0
        self.paused, self.done = at_end == 'hold', at_end == 'stop'
        self._log_end(': holding until a signal, reset or seek' if self.paused else '')
        return None

    def _log_end(self, then: str) -> None:
        pacer = self.pacer
        if pacer.overruns:
            self._node.get_logger().warning(f'{self._source.ending()}{then}; {pacer.overruns} overruns, the worst '
                                            f'{pacer.worst_late_s:.3f} s late')
        else:
            self._node.get_logger().info(f'{self._source.ending()}{then}')

    def _log_progress(self) -> None:
        """Log the progress every second if somebody reads it."""
        if time.monotonic() - self._logged_s >= _PROGRESS_S and logs.progress_wanted() and not self.stands():
            pacer, left_s = self.pacer, self._left_s()
            left = '' if left_s is None else f', {left_s:.0f} s left'
            self._node.get_logger().info(
                f'{self._source.place()}{left}, {pacer.overruns} overruns',
                data={'t_s': (pacer.last_ns or 0) / NS, 'left_s': left_s, 'overruns': pacer.overruns,
                      'time_scale': pacer.scale})
            self._note_place()

    def _left_s(self) -> float | None:
        """Return the wall time until the end at the recent speed; None if time has not advanced."""
        t_ns = self.pacer.last_ns
        if t_ns is None or self._logged_ns is None or t_ns <= self._logged_ns:
            return None
        wall_s = time.monotonic() - self._logged_s
        return round(wall_s * (self._source.last_ns() - t_ns) / (t_ns - self._logged_ns), 3)

    def _note_place(self) -> None:
        self._logged_s, self._logged_ns = time.monotonic(), self.pacer.last_ns
