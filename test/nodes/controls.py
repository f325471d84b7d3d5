"""Calls to a running sim, drawn from a seed: services, and live parameters with valid and invalid values.

Each answer is compared with the table of parameters. A value is accepted if it has the right type, is within the limits
and is one of the choices; otherwise the sim answers with a one-line reason and keeps the old value. To call a sim by
hand, start one that does not end, and then, in the same ROS domain, run
``./dragon python test/nodes/controls.py --calls 10000``. The soak test runs this program in the background, and makes
only calls that skip no tick.
"""
import argparse
import json
import math
import random
import re
import signal
import sys
import time
from collections import Counter
from typing import Any

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_srvs.srv import Trigger

from dragon_ros.nodes.params import SIM, Parameter

PATIENCE_S = 60.0
SERVICES = ('pause', 'resume', 'step', 'seek', 'reset')
_AT = re.compile(r'at (\d+\.\d+) s')
_KINDS = {bool: (ParameterType.PARAMETER_BOOL, 'bool_value'), int: (ParameterType.PARAMETER_INTEGER, 'integer_value'),
          float: (ParameterType.PARAMETER_DOUBLE, 'double_value'),
          str: (ParameterType.PARAMETER_STRING, 'string_value'),
          bytes: (ParameterType.PARAMETER_BYTE_ARRAY, 'byte_array_value'),
          list: (ParameterType.PARAMETER_STRING_ARRAY, 'string_array_value'),
          type(None): (ParameterType.PARAMETER_NOT_SET, '')}
_ODD: tuple[Any, ...] = (
    True, None, b'\xff', ['a', ''], '', 'loop', 'stop', 'x' * 70_000, '\0', '\ud7ff', 0, 1, -1, 1000, 1001, 2**63 - 1,
    -2**63, 0.0, -0.0, 5e-324, 1e-300, 1e-13, 1e6, math.nextafter(1e6, math.inf), -5e-324, 1e308, math.inf, -math.inf,
    math.nan, -1.0, math.nextafter(-1.0, -2.0), 2**31 - 1.0, 2.0**31, 412.0, 0.1)


def fits(parameter: Parameter, value: Any) -> bool:
    """Return whether a live parameter accepts a value, according to the table of parameters."""
    if isinstance(parameter.default, float) and type(value) is int:
        value = float(value)
    if not parameter.live or type(value) is not type(parameter.default):
        return False
    if parameter.choices:
        return value in parameter.choices
    return parameter.low is None or parameter.high is None or parameter.low <= value <= parameter.high


class Caller:
    """A client that calls a sim and counts the calls; ``faults`` lists deviations from the table."""

    def __init__(self, seed: int, name: str = '/dragon/sim') -> None:
        """Open the clients in their own context, and wait for the sim."""
        self._rng = random.Random(seed)
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('controls', context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        kinds = {**dict.fromkeys(SERVICES, Trigger), 'set_parameters': SetParameters, 'get_parameters': GetParameters}
        self._clients = {one: self._node.create_client(kind, f'{name}/{one}') for one, kind in kinds.items()}
        self._table = {one.name: one for one in SIM}
        self.at_s = 0.0     # the last known position of the sim
        self.counts: Counter[str] = Counter()
        self.faults: list[str] = []
        self._until(lambda: all(one.service_is_ready() for one in self._clients.values()))

    def close(self) -> None:
        """End the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _until(self, done: Any) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not done():
            if time.monotonic() > end_s:
                raise TimeoutError(f'no answer within {PATIENCE_S:g} s')
            self._executor.spin_once(timeout_sec=0.05)

    def _ask(self, name: str, request: Any) -> Any:
        future = self._clients[name].call_async(request)
        self._until(future.done)
        self.counts[name] += 1
        return future.result()

    def serve(self, name: str) -> tuple[bool, str]:
        """Call a service, and check that its answer is one line."""
        answer = self._ask(name, Trigger.Request())
        if '\n' in answer.message or not answer.message:
            self.faults.append(f'{name}: {answer.message!r} is not one line')
        if place := _AT.search(answer.message):
            self.at_s = float(place[1])
        return answer.success, answer.message

    def set(self, name: str, value: Any) -> bool:
        """Set a parameter; compare the answer and the resulting value with the table."""
        kind, member = _KINDS[type(value)]
        content = {member: [bytes([one]) for one in value] if isinstance(value, bytes) else value} if member else {}
        given = ParameterMessage(name=name, value=ParameterValue(type=kind, **content))
        before = self.get(name)
        (result,) = self._ask('set_parameters', SetParameters.Request(parameters=[given])).results
        after, known = self.get(name), self._table.get(name)
        self.counts['taken' if result.successful else 'refused'] += 1
        shown = f'{name}={value!r:.60}'
        if result.successful and (known is None or not fits(known, value)):
            self.faults.append(f'{shown} was taken')
        if not result.successful and (not result.reason or '\n' in result.reason or len(result.reason) > 1000):
            self.faults.append(f'{shown} was refused with {result.reason[:200]!r}')
        if not result.successful and known and fits(known, value) and not result.reason.startswith(('seek_s', 'time')):
            self.faults.append(f'{shown} was refused: {result.reason}')
        if after != (value if result.successful else before):
            self.faults.append(f'{shown}: it was {before!r:.60} and is {after!r:.60}')
        return bool(result.successful)

    def get(self, name: str) -> Any:
        """Return the value of a parameter, or None if it has none."""
        for value in self._ask('get_parameters', GetParameters.Request(names=[name])).values:
            return next((getattr(value, member) for kind, member in _KINDS.values() if member and kind == value.type),
                        None)
        return None

    def any_call(self) -> None:
        """Make any call that an untrusted user might make; the sim need not continue with a sensible run."""
        rng = self._rng
        if rng.random() < 0.4:
            self.serve(rng.choice(SERVICES))
            return
        name = rng.choice([*(one.name for one in SIM if one.live), *self._table, 'use_sim_time_', ''])
        self.set(name, rng.choice([*_ODD, *self._likely(name)]))
        if name == 'at_end':
            self.set(name, 'hold')      # if the sim stops at the end of its run, no further call is possible

    def _likely(self, name: str) -> list[Any]:
        """Return values that a parameter may have: its limits and a value between them, or its choices."""
        known = self._table.get(name)
        if known is None or known.low is None or known.high is None:
            return list(known.choices) if known else []
        return [known.low, known.high, self._rng.uniform(known.low, known.high)]

    def harmless_call(self) -> None:
        """Pause, step, go back, change the speed or set invalid values, and resume; none of these skips a tick."""
        rng, what = self._rng, self._rng.choice(('pause', 'step', 'back', 'speed', 'odd'))
        if what == 'pause':
            self.serve('pause')
            time.sleep(rng.uniform(0.0, 0.4))
        elif what == 'step':
            self.set('step_ticks', rng.randint(1, 20))
            self.serve('step')
        elif what == 'back':
            self.serve('pause')
            self.set('seek_s', max(0.0, self.at_s - rng.uniform(0.0, 2.0)))
            self.serve('seek')
        elif what == 'speed':
            self.set('time_scale', rng.uniform(0.8, 1.4))
        else:
            for name in ('step_ticks', 'at_end', 'seek_s'):
                self.set(name, rng.choice(_ODD))
            self.set('at_end', 'stop')
        self.serve('resume')
        self.counts['controls'] += 1


def main(argv: list[str]) -> int:
    """Call a sim and print the results as JSON; the exit code is 1 if an answer was wrong."""
    options = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    options.add_argument('--calls', type=int, default=10_000, help='minimum number of requests to send (10000)')
    options.add_argument('--harmless', action='store_true', help='make only calls that skip no tick, until SIGINT')
    options.add_argument('--each-s', type=float, default=0.0, help='seconds between two calls (0)')
    options.add_argument('--seed', type=int, default=1, help='seed for the calls (1)')
    arguments = options.parse_args(argv)
    ended: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: ended.append(number))
    caller, told_s = Caller(arguments.seed), time.monotonic()
    try:
        while not ended and (arguments.harmless or called(caller.counts) < arguments.calls):
            (caller.harmless_call if arguments.harmless else caller.any_call)()
            time.sleep(arguments.each_s)
            if time.monotonic() - told_s > 60:
                told_s = time.monotonic()
                print(dict(caller.counts), caller.faults[:5], file=sys.stderr, flush=True)
    except TimeoutError as error:
        caller.faults.append(str(error))
    print(json.dumps({**caller.counts, 'calls': called(caller.counts), 'faults': caller.faults}), flush=True)
    caller.close()
    return int(bool(caller.faults))


def called(counts: Counter[str]) -> int:
    """Return the number of answered requests, excluding reads of parameters."""
    return sum(counts[name] for name in (*SERVICES, 'set_parameters'))


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
