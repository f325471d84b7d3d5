"""The standard simulator services of a sim and a replay, called over real DDS if their package is installed."""
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from dragon_ros.__main__ import main
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import half_turns
from dragon_ros.scenes.load import load_scene

SCENE = ('--scene', 'first_contact', '--set', 'run.stop_s=401')
LAST = 50
needs_standard = pytest.mark.skipif(find_spec('simulation_interfaces') is None,
                                    reason='simulation_interfaces is not installed, and has no wheel: apt install '
                                    'ros-jazzy-simulation-interfaces')


class Simulator:
    """A client of the standard services that contains nothing specific to dragons."""

    def __init__(self, node, name):
        from simulation_interfaces import action, msg, srv
        self.node, self.name, self.msg, self.srv, self.action = node, name, msg, srv, action

    def call(self, kind, **fields):
        request = getattr(self.srv, kind).Request(**fields)
        snake = ''.join(f'_{one.lower()}' if one.isupper() else one for one in kind)[1:]
        client = self.node.create_client(getattr(self.srv, kind), f'{self.name}/{snake}')
        self.node.until(client.service_is_ready)
        future = client.call_async(request)
        self.node.until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def set(self, name):
        """Set a state, and return the result code."""
        state = self.msg.SimulationState(state=getattr(self.msg.SimulationState, f'STATE_{name}'))
        return self.call('SetSimulationState', state=state).result.result

    @property
    def state(self):
        number = self.call('GetSimulationState').state.state
        return next(name for name in ('STOPPED', 'PLAYING', 'PAUSED', 'QUITTING')
                    if getattr(self.msg.SimulationState, f'STATE_{name}') == number)

    def offered(self):
        """Return the standard services that the simulator offers."""
        namespace, _, name = self.name.rpartition('/')
        self.node.until(lambda: (name, namespace) in self.node.get_node_names_and_namespaces())
        return {service.rpartition('/')[2] for service, kinds in self.node.get_service_names_and_types_by_node(
            name, namespace) if kinds[0].startswith('simulation_interfaces/srv')}

    def where(self, entity='handle_0'):
        return self.call('GetEntityState', entity=entity).state

    def tick(self):
        stamp = self.where().header.stamp
        return round((stamp.sec - 400 + stamp.nanosec / 1e9) * 50)

    def entities(self, kind='GetEntities', **filters):
        return self.call(kind, filters=self.msg.EntityFilters(**filters))

    def bounds(self, kind, *points):
        from geometry_msgs.msg import Vector3
        return self.msg.Bounds(type=getattr(self.msg.Bounds, f'TYPE_{kind}'), points=[
            Vector3(x=float(x), y=float(y), z=float(z)) for x, y, z in points])

    def steps(self, count, heard=None, cancel_after=None):
        """Simulate steps via the action; return its feedback (at least ``heard`` messages), status and result."""
        from rclpy.action import ActionClient
        from rclpy.qos import QoSProfile
        client, told = ActionClient(self.node, self.action.SimulateSteps, f'{self.name}/simulate_steps',
                                    feedback_sub_qos_profile=QoSProfile(depth=1000)), []
        self.node.until(client.server_is_ready)
        sent = client.send_goal_async(self.action.SimulateSteps.Goal(steps=count),
                                      feedback_callback=lambda one: told.append(one.feedback))
        self.node.until(sent.done)
        goal = sent.result()
        answered = goal.get_result_async()
        if cancel_after is not None:
            self.node.until(lambda: len(told) >= cancel_after)
            goal.cancel_goal_async()
        self.node.until(answered.done)
        self.node.until(lambda: heard is None or len(told) >= heard)        # feedback may arrive after the result
        client.destroy()
        return [(one.completed_steps, one.remaining_steps) for one in told], answered.result().status, (
            answered.result().result.result.result)


@pytest.fixture
def sim(start, node):
    """A paused sim at tick 0."""
    simulator = Simulator(node, '/dragon/sim')
    simulator.process = start('sim', *SCENE, '--ros-args', '-p', 'discovery_s:=60.0', '-p', 'at_end:=hold')
    assert simulator.set('PAUSED') == 1
    return simulator


def stands_at(simulator, k):
    assert (simulator.state, simulator.tick()) == ('PAUSED', k)


@needs_standard
def test_it_starts_playing_and_before_its_first_tick_there_is_no_entity_to_tell_of(start, node):
    sim = Simulator(node, '/dragon/sim')
    start('sim', *SCENE, '--ros-args', '-p', 'discovery_s:=60.0')
    assert sim.state == 'PLAYING'
    assert sim.entities().result.result == sim.msg.Result.RESULT_INCORRECT_STATE


@needs_standard
def test_every_feature_that_is_told_is_offered_and_no_other(sim):
    told = set(sim.call('GetSimulatorFeatures').features.features)
    kind = sim.msg.SimulatorFeatures
    names = {name for name in dir(kind) if type(getattr(kind, name)) is int and getattr(kind, name) in told}
    assert names == {
        'ENTITY_TAGS', 'ENTITY_BOUNDS_BOX', 'ENTITY_BOUNDS_CONVEX', 'ENTITY_CATEGORIES', 'ENTITY_STATE_GETTING',
        'ENTITY_INFO_GETTING', 'SIMULATION_RESET', 'SIMULATION_STATE_GETTING', 'SIMULATION_STATE_SETTING',
        'SIMULATION_STATE_PAUSE', 'STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE', 'STEP_SIMULATION_ACTION'}
    assert sim.offered() == {
        'get_simulator_features', 'get_simulation_state', 'set_simulation_state', 'reset_simulation', 'step_simulation',
        'get_entities', 'get_entity_state', 'get_entities_states', 'get_entity_info'}


@needs_standard
def test_states_change_as_the_standard_says(sim):
    kind = sim.srv.SetSimulationState.Response
    assert sim.state == 'PAUSED'
    assert sim.set('PAUSED') == kind.ALREADY_IN_TARGET_STATE
    assert sim.set('NO_WORLD') == sim.msg.Result.RESULT_FEATURE_UNSUPPORTED
    assert sim.call('StepSimulation', steps=3).result.result == 1
    stands_at(sim, 2)
    assert sim.set('STOPPED') == 1
    assert (sim.state, sim.tick()) == ('STOPPED', 0)
    assert sim.set('STOPPED') == kind.ALREADY_IN_TARGET_STATE
    assert sim.call('StepSimulation').result.result == sim.msg.Result.RESULT_OPERATION_FAILED
    assert sim.set('PAUSED') == 1
    stands_at(sim, 0)
    assert sim.set('PLAYING') == 1
    sim.process.wait_for('holding until a signal')
    stands_at(sim, LAST)
    assert sim.set('PLAYING') == kind.STATE_TRANSITION_ERROR
    assert sim.set('QUITTING') == 1
    assert sim.process.end() == 0, sim.process.text


@needs_standard
def test_steps_are_counted_from_a_pause_alone_and_end_with_the_run(sim):
    failed = sim.msg.Result.RESULT_OPERATION_FAILED
    assert sim.call('StepSimulation').result.result == 1        # the first frame
    stands_at(sim, 0)
    assert sim.call('StepSimulation', steps=0).result.result == 1
    stands_at(sim, 0)
    assert sim.call('StepSimulation', steps=5).result.result == 1
    stands_at(sim, 5)
    result = sim.call('StepSimulation', steps=2**64 - 1).result
    assert (result.result, result.error_message.split(',')[0]) == (
        failed, f'45 of {2**64 - 1} steps were shown before the run ended')
    stands_at(sim, LAST)
    assert sim.call('StepSimulation').result.result == failed
    assert sim.call('ResetSimulation').result.result == 1
    stands_at(sim, 0)
    assert sim.set('PLAYING') == 1
    assert sim.call('StepSimulation').result.result == failed


@needs_standard
def test_steps_by_the_action_are_told_one_by_one_and_end_with_the_run(sim):
    from action_msgs.msg import GoalStatus
    assert sim.steps(4, heard=4) == ([(1, 3), (2, 2), (3, 1), (4, 0)], GoalStatus.STATUS_SUCCEEDED, 1)
    stands_at(sim, 3)
    told, status, result = sim.steps(100, heard=LAST - 3)
    assert (len(told), status, result) == (LAST - 3, GoalStatus.STATUS_ABORTED, sim.msg.Result.RESULT_OPERATION_FAILED)
    stands_at(sim, LAST)


@needs_standard
def test_a_cancelled_goal_stops_after_the_step_in_which_it_was_cancelled(start, node):
    from action_msgs.msg import GoalStatus
    sim = Simulator(node, '/dragon/sim')
    start('sim', '--scene', 'winding', '--ros-args', '-p', 'discovery_s:=60.0')
    assert sim.set('PAUSED') == 1
    told, status, result = sim.steps(20_000, cancel_after=3)
    assert (status, result) == (GoalStatus.STATUS_CANCELED, sim.msg.Result.RESULT_OPERATION_FAILED)
    stamp = sim.where().header.stamp
    shown = round((stamp.sec + stamp.nanosec / 1e9) * 50) + 1
    assert max(3, told[-1][0]) <= shown < 20_000
    assert told[-1][0] + told[-1][1] == 20_000
    assert sim.state == 'PAUSED'


@needs_standard
@pytest.mark.parametrize(('scope', 'code'), [(0, 1), (255, 1), (3, 1), (7, 1), (1, 0), (2, 0), (4, 0)])
def test_time_and_state_are_reset_together_or_not_at_all(sim, scope, code):
    assert sim.call('StepSimulation', steps=3).result.result == 1
    assert sim.call('ResetSimulation', scope=scope).result.result == code
    stands_at(sim, 0 if code else 2)


@needs_standard
def test_entities_have_the_state_of_their_handle_or_bench(sim):
    assert sim.call('StepSimulation', steps=11).result.result == 1
    frame = tick(load_scene('first_contact', ['run.stop_s=401']), 10)
    answer = sim.entities('GetEntitiesStates')
    assert answer.entities == [f'handle_{i}' for i in range(224)] + [f'bench_{i}' for i in range(223)]
    poses = np.array([(one.pose.position.x, one.pose.position.y, one.pose.orientation.z, one.pose.orientation.w)
                      for one in answer.states])
    assert np.array_equal(poses[:224, :2], frame.chain.p)
    assert np.array_equal(poses[224:, :2], frame.benches.centre)
    assert np.array_equal(poses[224:, 2:], half_turns(frame.axis))
    assert np.array_equal(poses[:223, 2:], half_turns(frame.axis))
    speeds = np.array([(one.twist.linear.x, one.twist.linear.y) for one in answer.states])
    assert np.array_equal(speeds[:224], frame.velocity_m_s)
    assert all(np.isnan(one.acceleration.linear.x) for one in answer.states)
    assert {(one.header.frame_id, one.header.stamp.sec, one.header.stamp.nanosec) for one in answer.states} == {
        ('dragon', 400, 200_000_000)}
    assert sim.where('bench_7') == answer.states[224 + 7] or np.isnan(sim.where('bench_7').acceleration.linear.x)
    assert sim.call('GetEntityState', entity='bench_223').result.result == sim.msg.Result.RESULT_NOT_FOUND
    info = sim.call('GetEntityInfo', entity='bench_222').info
    assert (info.tags, info.category.category) == (['bench', 'tail'], 4)
    assert info.description == 'bench 222 of 223, counted from the head: 2.2 m by 0.3 m'


@needs_standard
def test_filters_are_honoured_together_and_what_they_cannot_be_is_refused(sim):
    assert sim.call('StepSimulation').result.result == 1
    kinds, tags = sim.msg.EntityCategory, sim.msg.TagsFilter
    head = tick(load_scene('first_contact'), 0).chain.p[0].tolist()
    near = sim.bounds('SPHERE', (*head, 0), (0.1, 0, 0))

    def names(**filters):
        answer = sim.entities(**filters)
        assert answer.result.result == 1, answer.result.error_message
        return answer.entities
    assert names(filter='(bench|handle)_[[:digit:]]') == [f'{kind}_{i}' for kind in ('handle', 'bench')
                                                          for i in range(10)]
    assert names(categories=[kinds(category=kinds.CATEGORY_HUMAN)]) == []
    assert len(names(categories=[kinds(category=k) for k in (0, 4)])) == 447
    assert names(tags=tags(tags=['head'])) == ['handle_0', 'bench_0']
    assert names(tags=tags(tags=['head', 'bench'], filter_mode=tags.FILTER_MODE_ALL)) == ['bench_0']
    assert names(bounds=near) == ['handle_0', 'bench_0']
    assert names(bounds=near, filter='b.*', tags=tags(tags=['head'])) == ['bench_0']
    for code, filters in ((4, {'filter': '('}), (4, {'bounds': sim.bounds('BOX', (0, 0, 0))}),
                          (0, {'bounds': sim.msg.Bounds(type=9)}), (4, {'tags': tags(tags=['a'], filter_mode=7)})):
        result = sim.entities(**filters).result
        assert (result.result, bool(result.error_message)) == (code, True)


@needs_standard
def test_a_replay_offers_the_same_of_what_its_bag_holds(start, node, tmp_path):
    assert main(['simulate', *SCENE, '--set', 'effects=[velocity, benches, accelerations]', '--output',
                 str(tmp_path / 'a.mcap')]) == 0
    replay = Simulator(node, '/dragon/replay')
    process = start('replay', tmp_path / 'a.mcap', '--ros-args', '-p', 'discovery_s:=60.0')
    assert replay.set('PAUSED') == 1
    assert replay.call('StepSimulation', steps=6).result.result == 1
    stands_at(replay, 5)
    scene = load_scene('first_contact', ['effects=[velocity, benches, accelerations]'])
    frame, state = tick(scene, 5), replay.where('bench_3')
    assert [state.pose.position.x, state.pose.position.y] == frame.benches.centre[3].tolist()
    mean = (frame.acceleration_m_s2[3] + frame.acceleration_m_s2[4]) / 2
    assert [state.acceleration.linear.x, state.acceleration.linear.y] == pytest.approx(mean.tolist(), abs=1e-12)
    assert len(replay.entities().entities) == 447
    assert replay.steps(2, heard=2)[0] == [(1, 1), (2, 0)]
    assert replay.set('QUITTING') == 1
    assert process.end() == 0, process.text


@needs_standard
def test_a_replay_without_handles_tells_that_it_has_no_entities(start, node, tmp_path):
    assert main(['simulate', *SCENE, '--output', str(tmp_path / 'a.mcap')]) == 0
    replay = Simulator(node, '/dragon/replay')
    start('replay', tmp_path / 'a.mcap', '--topics', 'benches', '--ros-args', '-p', 'discovery_s:=60.0')
    told = replay.call('GetSimulatorFeatures').features.features
    assert replay.msg.SimulatorFeatures.ENTITY_STATE_GETTING not in told
    assert replay.msg.SimulatorFeatures.STEP_SIMULATION_ACTION in told
    assert 'get_simulation_state' in replay.offered()
    assert 'get_entities' not in replay.offered()


def test_without_the_package_nothing_is_offered_and_nothing_loaded(domain, monkeypatch):
    import rclpy

    from dragon_ros.nodes.sim import Sim
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', None)      # this makes the import of the package fail
    monkeypatch.delitem(sys.modules, 'dragon_ros.nodes.simulation_interfaces', raising=False)
    rclpy.init()
    try:
        node = Sim(scene='first_contact')
        names = {name.rpartition('/')[2] for name, _ in node.get_service_names_and_types_by_node('sim', '/dragon')}
        assert {'pause', 'step'} < names
        assert not {'get_simulator_features', 'step_simulation', '_action'} & names
        assert 'dragon_ros.nodes.simulation_interfaces' not in sys.modules
        assert not list(node.guards)
        node.destroy_node()
    finally:
        rclpy.shutdown()
