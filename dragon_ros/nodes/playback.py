"""Playback of frames in simulation time: pause, resume, reset, step, seek and speed, in any executor.

A timer on the steady clock, set to the due time of the next frame, plays that frame. As with a rosbag2 player, service
names include the node's name (``/dragon/sim/pause``), so that a sim and a replay in one namespace do not collide.
"""
import time
from collections.abc import Callable

from std_srvs.srv import Trigger

from dragon_ros.core.errors import DragonError
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.pacer import Pacer
from dragon_ros.nodes.play_source import PlaySource
from dragon_ros.nodes.progress import ProgressLog

STANDARD = 'simulation_interfaces'      # package of the standard services; they are offered if it is installed
_POLL_NS = 20_000_000       # interval between checks of whether playback may start
_SLICE_S = 0.005            # maximum time of playback before other callbacks run
_AGAIN_NS = 1_000_000_000   # interval between repetitions of a single frame


def _nothing() -> None:
    """Do nothing."""


class Steps:
    """A number of frames to show immediately.

    ``shown`` frames have been shown and ``left`` frames remain; ``ended`` is true when no more will be shown.
    """

    def __init__(self, frames: int, each: Callable[[], None] = _nothing, end: Callable[[], None] = _nothing) -> None:
        """``each`` is called after each frame, and ``end`` is called once when no more will be shown."""
        self.shown, self.left, self.ended = 0, frames, frames == 0
        self._each, self._end = each, end

    def count(self) -> None:
        """Count one frame that was shown."""
        self.shown, self.left = self.shown + 1, self.left - 1
        self._each()
        if not self.left:
            self.finish()

    def finish(self) -> None:
        """Abandon the remaining frames."""
        if not self.ended:
            self.ended = True
            self._end()


class Player:
    """Plays a source on a node that has the parameters ``CONTROLS``; ``done`` is true once playback has ended.

    ``stopped`` is true while the player is paused at the first frame after ``stop``.
    """

    def __init__(self, node: DragonNode, source: PlaySource, time_scale: float, ready: Callable[[], bool]) -> None:
        """Offer the services; playback starts when ``ready()`` is true."""
        self.pacer, self.paused, self.stopped, self.done = Pacer(time_scale), False, False, False
        self._node, self._source, self._ready = node, source, ready
        self._waiting, self._holds, self._owed = True, False, Steps(0)
        self._progress = ProgressLog(node.get_logger(), source, self.pacer)
        self._timer = node.create_timer(0.0, self._on_timer, clock=STEADY)
        for name in ('pause', 'resume', 'reset', 'step', 'seek'):
            node.create_service(Trigger, f'~/{name}', self._service(getattr(self, name)))

    def pause(self) -> str:
        """Pause after the last frame."""
        self.paused, self.stopped, self._holds = True, False, False
        return f'paused {self._source.place()}'

    def resume(self) -> str:
        """Resume; the next frame is due one tick from now. Raises DragonError if the player holds at the end."""
        if self._node.setting['at_end'] == 'hold':
            self._check_next()
        self.paused = self.stopped = self._holds = False
        self._wake()
        return f'resumed {self._source.place()}'

    def reset(self) -> str:
        """Return to the first frame and show it, so that time jumps backwards; a paused player stays paused.

        A player that holds at the end starts again.
        """
        if self._holds:
            self.paused = self._holds = False
        self._source.rewind()
        return self._show_now(1) + self._pause_note()

    def step(self) -> str:
        """Pause, and play the next ``step_ticks`` frames immediately."""
        self._check_next()
        self.pause()
        return self._show_now(self._node.setting['step_ticks'])

    def advance(self, steps: Steps) -> None:
        """Pause, and show frames for a few milliseconds at a time. Raises DragonError if no frames follow.

        Any other action that shows a frame ends the steps early.
        """
        self._check_next()
        self.pause()
        self._owe(steps)
        self._wake(self._play() or 0)

    def stop(self) -> str:
        """Return to the first frame and pause there, as if nothing had been played."""
        self.pause()
        place = self.reset()
        self.stopped = True
        return place

    def seek(self) -> str:
        """Show the last frame at or before ``seek_s`` (negative: the first frame); a paused player stays paused."""
        seek_s = self._node.setting['seek_s']
        return self.seek_to(None if seek_s < 0 else self._source.stamp_ns(seek_s))

    def seek_to(self, t_ns: int | None) -> str:
        """Show the last frame at or before ``t_ns`` (None: the first). Raises DragonError if there is no frame."""
        self._source.seek(t_ns)
        self.stopped = False
        return self._show_now(1) + self._pause_note()

    def _pause_note(self) -> str:
        return '; paused, call resume to continue' if self.paused else ''

    def quit(self) -> None:
        """End the playback permanently after the last frame shown."""
        self.pause()
        self.done = True

    def set_speed(self, time_scale: float) -> None:
        """Continue at a different speed from the current time, without a jump."""
        self.pacer.scale = time_scale
        self._wake()

    def stands(self) -> bool:
        """Return whether time is stopped: before the start, during a pause, or at the end."""
        return self._waiting or self.paused or self.done

    def is_stepping(self) -> bool:
        """Return whether frames remain to be shown immediately."""
        return not self._owed.ended

    def _service(self, act: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.success, response.message = True, act()
                self._progress.note_place()
            except DragonError as error:
                response.success, response.message = False, str(error)
            return response
        return serve

    def _show_now(self, frames: int) -> str:
        """Show a number of frames immediately, or as soon as slow readers have caught up."""
        self._owe(Steps(frames))
        while self.is_stepping() and self._play_owed():
            pass
        self._wake()
        left = self._owed.left if self.is_stepping() else 0
        return self._source.place() + (f'; {left} more to show when the readers catch up' if left else '')

    def _check_next(self) -> None:
        """Raise DragonError if no frame follows."""
        if self._source.next_ns() is None:
            raise DragonError(f'{self._source.ending()}: no frame follows; reset or seek first')

    def _owe(self, steps: Steps) -> None:
        """Set the frames to show immediately; any earlier ones that remain are abandoned."""
        before, self._owed, self.done = self._owed, steps, False
        before.finish()

    def _play_owed(self) -> bool:
        """Show the next frame of the current steps; return whether that was possible."""
        t_ns = self._source.next_ns()
        if t_ns is None:
            self._owed.finish()
        elif self._source.flush():
            self.pacer.rest()
            self.pacer.start(t_ns)
            self._source.show()
            self._owed.count()
        else:
            return False
        return True

    def _wake(self, delay_ns: int = 0) -> None:
        """Let the timer fire after ``delay_ns`` of wall time."""
        self._timer.timer_period_ns = delay_ns
        self._timer.reset()

    def _on_timer(self) -> None:
        delay_ns = self._play()
        if delay_ns is None:
            self._timer.cancel()
        else:
            self._wake(delay_ns)

    def _play(self) -> int | None:
        """Play the due frames; return the wall time (ns) until the next action, or None to wait for a service call."""
        if self._waiting and not self.is_stepping():
            if not self._ready():
                return _POLL_NS
            self._waiting = False
            self._node.get_logger().info(f'starting {self._source.place()}')
        until = time.monotonic() + _SLICE_S
        delay_ns: int | None = 0
        while delay_ns == 0 and time.monotonic() < until:
            delay_ns = self._play_one()
        if not self.stands():
            self._progress.log()
        return delay_ns

    def _play_one(self) -> int | None:
        """Play one frame if it is due; the result is that of ``_play``."""
        if not self._source.flush():
            return 0
        if self.is_stepping():
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
        """Take the action that ``at_end`` states; the result is that of ``_play``."""
        at_end = self._node.setting['at_end']
        if at_end == 'loop':
            self._source.rewind()
            self.pacer.rest()
            return _AGAIN_NS if self.pacer.scale and self._source.next_ns() == self.pacer.last_ns else 0
        self.paused = self._holds = at_end == 'hold'
        self.done = at_end == 'stop'
        self._progress.log_end(': holding until a signal, reset or seek' if self.paused else '')
        return None
