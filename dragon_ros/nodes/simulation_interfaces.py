"""Offer ``simulation_interfaces``, the ROS 2 standard for simulators, for a player.

This module is imported only if that package is installed. The names of the services and of the action include the
node's name, as in ``/dragon/sim/set_simulation_state``. All of them call the player and return the standard's result
codes.
"""
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import QoSProfile
from rclpy.task import Future
from simulation_interfaces import action, msg, srv

from dragon_ros.core.errors import DragonError
from dragon_ros.core.words import counted
from dragon_ros.messages.cdr import half_turns, stamp_of
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.entities import Bodies, Region, box, chosen, convex_hull, sphere
from dragon_ros.nodes.playback import Player, Steps

State, Result, Features = msg.SimulationState, msg.Result, msg.SimulatorFeatures
CATEGORY = msg.EntityCategory.CATEGORY_DYNAMIC_OBJECT       # category of handles and benches: moving but not human
_REGIONS = {msg.Bounds.TYPE_SPHERE: sphere, msg.Bounds.TYPE_BOX: box, msg.Bounds.TYPE_CONVEX_HULL: convex_hull}
_FEEDBACK = 1000            # number of messages kept for slow clients, since steps follow each other immediately
_CONTROLS = ('SIMULATION_RESET', 'SIMULATION_STATE_GETTING', 'SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE',
             'STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE', 'STEP_SIMULATION_ACTION')
_ENTITIES = ('ENTITY_TAGS', 'ENTITY_BOUNDS_BOX', 'ENTITY_BOUNDS_CONVEX', 'ENTITY_CATEGORIES', 'ENTITY_STATE_GETTING',
             'ENTITY_INFO_GETTING')
_ABOUT = ('A step is a tick of sim, or a log time of a bag. Time and state are reset together. Entities are '
          'handle_N and bench_N, in the plane z = 0; unknown velocities and accelerations are NaN.')


class _Refused(DragonError):
    """A request with a result other than RESULT_OK."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class SimulationInterfaces:
    """The services and the action of one player, which are destroyed with the node."""

    def __init__(self, node: DragonNode, player: Player, bodies: Callable[[], Bodies | None] | None) -> None:
        """Offer the services; ``bodies``, unless it is None, returns the entities of the last frame shown."""
        self._player, self._bodies = player, bodies
        serves = {'GetSimulatorFeatures': self._features, 'GetSimulationState': self._get_state,
                  'SetSimulationState': self._set_state, 'ResetSimulation': self._reset}
        if bodies:
            serves |= {'GetEntities': self._entities, 'GetEntityState': self._entity_state,
                       'GetEntitiesStates': self._entities_states, 'GetEntityInfo': self._entity_info}
        for name, serve in serves.items():
            node.create_service(getattr(srv, name), f'~/{_snake(name)}', _answering(serve))
        node.create_service(srv.StepSimulation, '~/step_simulation', self._step)
        self._steps = ActionServer(node, action.SimulateSteps, '~/simulate_steps', self._simulate,
                                   cancel_callback=lambda _: CancelResponse.ACCEPT,
                                   feedback_pub_qos_profile=QoSProfile(depth=_FEEDBACK))
        self._ended = node.create_guard_condition(lambda: None)      # wakes the executor, so that it checks its futures
        node.closing.append(self._steps.destroy)

    def _features(self, _: Any, response: Any) -> None:
        names = _CONTROLS + (_ENTITIES if self._bodies else ())
        response.features.features = [getattr(Features, name) for name in names]
        response.features.custom_info = _ABOUT

    def _get_state(self, _: Any, response: Any) -> None:
        response.state.state = self._state()

    def _state(self) -> int:
        player = self._player
        if player.done:
            return int(State.STATE_QUITTING)
        if player.paused:
            return int(State.STATE_STOPPED if player.stopped else State.STATE_PAUSED)
        return int(State.STATE_PLAYING)

    def _set_state(self, request: Any, _: Any) -> None:
        wanted, kind = request.state.state, srv.SetSimulationState.Response
        acts = {State.STATE_STOPPED: self._player.stop, State.STATE_PLAYING: self._player.resume,
                State.STATE_PAUSED: self._player.pause, State.STATE_QUITTING: self._player.quit}
        if wanted not in acts:
            raise _Refused(Result.RESULT_FEATURE_UNSUPPORTED, f'state {wanted} cannot be set, because the world cannot '
                                                              'be replaced; set stopped, playing, paused or quitting')
        if wanted == self._state():
            raise _Refused(kind.ALREADY_IN_TARGET_STATE, 'the simulation is already in this state')
        try:
            acts[wanted]()
        except DragonError as error:
            raise _Refused(kind.STATE_TRANSITION_ERROR, str(error)) from None

    def _reset(self, request: Any, _: Any) -> None:
        kind = srv.ResetSimulation.Request
        both = kind.SCOPE_TIME | kind.SCOPE_STATE
        if request.scope != kind.SCOPE_DEFAULT and request.scope & both != both:
            raise _Refused(Result.RESULT_FEATURE_UNSUPPORTED, f'scope {request.scope}: time and state are reset '
                           f'together; give {kind.SCOPE_ALL} or {both}')
        self._player.reset()

    async def _step(self, request: Any, response: Any) -> Any:
        response.result = await self._stepped(request.steps)
        return response

    async def _simulate(self, goal: ServerGoalHandle) -> Any:
        result = await self._stepped(goal.request.steps, goal)
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            (goal.succeed if result.result == Result.RESULT_OK else goal.abort)()
        return action.SimulateSteps.Result(result=result)

    async def _stepped(self, frames: int, goal: ServerGoalHandle | None = None) -> Any:
        """Show frames of a paused simulation; return the result when all of them have been shown."""
        ended = Future()

        def each() -> None:
            if goal:
                goal.publish_feedback(action.SimulateSteps.Feedback(completed_steps=steps.shown,
                                                                    remaining_steps=steps.left))
                if goal.is_cancel_requested:
                    steps.finish()

        def end() -> None:
            ended.set_result(None)
            self._ended.trigger()
        steps = Steps(frames, each, end)
        try:
            self._check_paused()
            if frames:
                self._player.advance(steps)
        except DragonError as error:
            return _failed(str(error))
        while not steps.ended:
            await ended
        return _failed(f'{steps.shown} of {counted(frames, "step")} shown before the run ended, the request was '
                       'cancelled, or another control took over') if steps.left else Result(result=Result.RESULT_OK)

    def _check_paused(self) -> None:
        if self._state() != State.STATE_PAUSED:
            raise DragonError('the simulation is not paused; set STATE_PAUSED first')
        if self._player.is_stepping():
            raise DragonError('earlier steps are still being shown; wait for them')

    def _entities(self, request: Any, response: Any) -> None:
        bodies = self._shown()
        names = bodies.names
        response.entities = [names[i] for i in _filtered(bodies, request.filters)]

    def _entities_states(self, request: Any, response: Any) -> None:
        bodies = self._shown()
        names, found = bodies.names, _filtered(bodies, request.filters)
        response.entities, response.states = [names[i] for i in found], _states(bodies, found)

    def _entity_state(self, request: Any, response: Any) -> None:
        bodies = self._shown()
        (response.state,) = _states(bodies, [_named(bodies, request.entity)])

    def _entity_info(self, request: Any, response: Any) -> None:
        bodies = self._shown()
        entity = _named(bodies, request.entity)
        response.info.category.category = CATEGORY
        response.info.tags, response.info.description = bodies.tags_of(entity), bodies.description_of(entity)

    def _shown(self) -> Bodies:
        assert self._bodies
        bodies = self._bodies()
        if bodies is None:
            raise _Refused(Result.RESULT_INCORRECT_STATE, 'nothing has been shown yet, because the simulation is '
                                                          'waiting for its readers')
        return bodies


def _snake(name: str) -> str:
    return re.sub('(?<!^)(?=[A-Z])', '_', name).lower()


def _failed(message: str) -> Any:
    return Result(result=Result.RESULT_OPERATION_FAILED, error_message=message)


def _answering(serve: Callable[[Any, Any], None]) -> Callable[[Any, Any], Any]:
    """Return a service that answers with the result code of the error that ``serve`` raises, or RESULT_OK."""
    def answer(request: Any, response: Any) -> Any:
        result = Result(result=Result.RESULT_OK)
        try:
            serve(request, response)
        except _Refused as refused:
            result = Result(result=refused.code, error_message=str(refused))
        except DragonError as error:
            result = _failed(str(error))
        if hasattr(response, 'result'):
            response.result = result
        return response
    return answer


def _named(bodies: Bodies, name: str) -> int:
    try:
        return bodies.names.index(name)
    except ValueError:
        raise _Refused(Result.RESULT_NOT_FOUND, f'there is no entity with this name; the first is {bodies.names[0]}, '
                       f'the last is {bodies.names[-1]}') from None


def _filtered(bodies: Bodies, filters: Any) -> list[int]:
    """Return the entities that pass the filters of a request. Raises DragonError."""
    mode, region = filters.tags.filter_mode, _region(filters.bounds)
    if mode not in (msg.TagsFilter.FILTER_MODE_ANY, msg.TagsFilter.FILTER_MODE_ALL):
        raise _Refused(Result.RESULT_OPERATION_FAILED, f'tags.filter_mode: {mode} is neither ANY (0) nor ALL (1)')
    if filters.categories and CATEGORY not in [one.category for one in filters.categories]:
        return []
    return chosen(bodies, filters.filter, filters.tags.tags, mode == msg.TagsFilter.FILTER_MODE_ALL, region)


def _region(bounds: Any) -> Region | None:
    if bounds.type == msg.Bounds.TYPE_EMPTY:
        return None
    if bounds.type not in _REGIONS:
        raise _Refused(Result.RESULT_FEATURE_UNSUPPORTED, f'bounds.type: {bounds.type} is not supported')
    return _REGIONS[bounds.type](np.array([(one.x, one.y, one.z) for one in bounds.points]).reshape(-1, 3))


def _states(bodies: Bodies, found: list[int]) -> list[Any]:
    """Return the states of entities as messages."""
    sec, nanosec = stamp_of(bodies.t_ns)
    turns = half_turns(bodies.axis[found]).tolist()
    columns = np.column_stack((bodies.place_m, bodies.velocity_m_s, bodies.yaw_rate_rad_s, bodies.acceleration_m_s2,
                               bodies.yaw_acceleration_rad_s2))[found].tolist()
    out = []
    for (x, y, vx, vy, w, ax, ay, w_rate), (z, real) in zip(columns, turns, strict=True):
        state = msg.EntityState()
        state.header.frame_id, state.header.stamp.sec, state.header.stamp.nanosec = bodies.frame_id, sec, nanosec
        state.pose.position.x, state.pose.position.y = x, y
        state.pose.orientation.z, state.pose.orientation.w = z, real
        state.twist.linear.x, state.twist.linear.y, state.twist.angular.z = vx, vy, w
        state.acceleration.linear.x, state.acceleration.linear.y, state.acceleration.angular.z = ax, ay, w_rate
        out.append(state)
    return out
