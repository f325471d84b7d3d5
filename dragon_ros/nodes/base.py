"""The base class of all nodes: namespace, parameters from a table, logger, and a warning if /clock is silent."""
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterValueException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.service import Service
from rclpy.subscription import Subscription

from dragon_ros.core.errors import DragonError, InputError, did_you_mean, shown
from dragon_ros.nodes import logs, qos, rclpy_internals, shell
from dragon_ros.nodes.params import NAMES, Parameter

_TYPES = frozenset(kind.value for kind in RosParameter.Type)
_KINDS = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'text'}


def declare(node: Node, parameter: Parameter, given: dict[str, Any]) -> Any:
    """Declare a parameter and return its value: the given value or the default.

    Raises InputError with the name and the limits of the parameter.
    """
    default, value = parameter.default, widened(parameter, given.get(parameter.name, parameter.default))
    if value == [] and isinstance(default, list):
        value = default
    if type(value) is not type(default) or (isinstance(value, list) and not all(isinstance(one, str) for one in value)):
        raise InputError(_wrong_type(parameter, value))
    try:
        node.declare_parameter(parameter.name, value, descriptor_of(parameter), ignore_override=True)
    except InvalidParameterValueException:
        raise InputError(f'parameter {parameter.name}: {shown(value)} is outside {parameter.low} to {parameter.high}; '
                         f'{parameter.text}') from None
    check(parameter, value)
    return value


def check(parameter: Parameter, value: Any) -> None:
    """Raise InputError if the value is not one of the choices, or is outside the limits, even by a rounding error.

    ROS also checks types and ranges, but accepts values that exceed a limit by a rounding error.
    """
    if parameter.choices and value not in parameter.choices:
        raise InputError(f'parameter {parameter.name}: {shown(value)} is not one of {", ".join(parameter.choices)}; '
                         f'{parameter.text}')
    if parameter.low is not None and parameter.high is not None and not parameter.low <= value <= parameter.high:
        raise InputError(f'parameter {parameter.name}: {value!r} is outside {parameter.low} to {parameter.high}; '
                         f'{parameter.text}')


def _wrong_type(parameter: Parameter, value: Any) -> str:
    """Return the error for a value of the wrong type."""
    kind, wanted = _KINDS.get(type(value), 'a list'), _KINDS.get(type(parameter.default), 'a list of text')
    value = value if type(value) in _KINDS else list(value)     # rclpy uses several classes for lists
    example = f'{parameter.name}:="{value}"'
    cure = f"quote it in YAML, for example -p '{example}'" if wanted == 'text' else f'give {wanted}'
    return f'parameter {parameter.name}: {shown(value)} is {kind}, not {wanted}; {cure}; {parameter.text}'


def widened(parameter: Parameter, value: Any) -> Any:
    """Return the value, converted to a float for ``-p rate_hz:=50``, and to text for ``-p accuracy:=0.001``."""
    if parameter.or_number and type(value) in (int, float):
        return repr(value)
    return float(value) if isinstance(parameter.default, float) and type(value) is int else value


def descriptor_of(parameter: Parameter) -> ParameterDescriptor:
    """Return the descriptor that ``ros2 param describe`` shows."""
    choices = f'one of {", ".join(parameter.choices)}' if parameter.choices else ''
    out = ParameterDescriptor(name=parameter.name, description=parameter.text, read_only=not parameter.live,
                              additional_constraints=choices)
    low, high = parameter.low, parameter.high
    if low is not None and high is not None:
        if isinstance(parameter.default, float):
            out.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            out.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return out


def _with_known_types(callback: Any) -> Any:
    """Return the callback of a service that sets parameters, which refuses types that rclpy does not know."""
    def set_parameters(request: Any, response: Any) -> Any:
        unknown = [one for one in request.parameters if one.value.type not in _TYPES]
        if not unknown:
            return callback(request, response)
        refused = SetParametersResult(successful=False, reason=f'parameter {shown(unknown[0].name)}: its type, '
                                      f'{unknown[0].value.type}, is unknown; nothing is set')
        if isinstance(response, SetParameters.Response):
            response.results = [refused] * len(request.parameters)
        else:
            response.result = refused
        return response
    return set_parameters


NAMESPACE = '/dragon'
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
_NO_CLOCK_S = 3.0
_QOS = 'qos_overrides.'         # ROS 2's prefix for parameters that override a topic's QoS
_POLICIES = ('history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan', 'liveliness',
             'liveliness_lease_duration')
_WAITING = {'history': 'keep_all', 'reliability': 'reliable', 'lifespan': None}     # fixed if a publisher waits
_MISSPELT = 0.85                # difflib ratio: rate_hx is a misspelt rate_hz (0.86); publish_rate is unknown (0.82)


class DragonNode(Node):
    """A node for any executor, in namespace /dragon by default.

    ``setting`` holds the values of the node's parameters. Subclasses override ``refuse`` to reject values and
    ``changed`` to react to new values.
    """

    _escaping: logs.NodeLogger | None = None
    _given: Mapping[str, Any] = MappingProxyType({})        # empty until rclpy has created its own topics

    def __init__(self, name: str, table: tuple[Parameter, ...] = (), overrides: dict[str, Any] | None = None) -> None:
        """Declare the parameters of the table.

        ``overrides`` takes precedence over the command line, except that lists are appended to the command line's
        lists. Raises InputError for an invalid value or a misspelt name.
        """
        lists = {key: value for key, value in (overrides or {}).items() if isinstance(value, list)}
        with shell.in_one_line('the node'):
            super().__init__(name, namespace=NAMESPACE, parameter_overrides=[
                RosParameter(key, value=value) for key, value in (overrides or {}).items() if key not in lists])
        given = rclpy_internals.given_parameters(self) | {
            key: value for key, value in (overrides or {}).items() if key not in lists}
        for key, value in lists.items():
            known = given.setdefault(key, [])
            given[key] = [*known, *value] if isinstance(known, list) else known     # declare() rejects other types
        self._table = {parameter.name: parameter for parameter in table}
        self.setting = {parameter.name: declare(self, parameter, given) for parameter in table}
        self._check_names(given)
        if line := rclpy_internals.notice():
            self.get_logger().info(line)
        self._given = given
        self.closing: list[Callable[[], object]] = []       # called before the node is destroyed
        self.add_pre_set_parameters_callback(self._widen)
        self.add_on_set_parameters_callback(self._on_set)
        self.add_post_set_parameters_callback(self._after_set)
        self._ros_time = self.get_clock()
        self._created = self.create_timer(0.0, self._check_overrides, clock=STEADY)
        self._patience = self.create_timer(_NO_CLOCK_S, self._check_clock, clock=STEADY)

    def destroy_node(self) -> None:
        """Destroy the objects that rclpy would leave behind, and then the node."""
        while self.closing:
            self.closing.pop()()
        super().destroy_node()

    def get_logger(self) -> Any:
        """Return the node's logger, which escapes control characters and can also write JSON."""
        self._escaping = self._escaping or logs.NodeLogger(super().get_logger())
        return self._escaping

    def _check_names(self, given: dict[str, Any]) -> None:
        """Raise InputError for a name that looks misspelt; warn about other names, since nodes may share a file."""
        for name in given:
            if self.has_parameter(name) or name.startswith(_QOS):
                continue
            unknown = f'parameter {name}: {self.get_name()} has no such parameter'
            if name not in NAMES and (meant := did_you_mean(name, self._table, '', _MISSPELT)):
                raise InputError(f'{unknown}; {meant} Put parameters of other nodes under their names, not under /**')
            known = f'choose from {", ".join(self._table)}' if self._table else 'it has no parameters of its own'
            hint = known if name in NAMES else did_you_mean(name, self._table, known)
            self.get_logger().warning(f'{unknown} and ignores it; {hint}')

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return a topic's full name, as rclpy does. Raises InputError if the name is invalid."""
        with shell.in_one_line(f'topic {shown(topic)}'):
            return str(super().resolve_topic_name(topic, only_expand=only_expand))

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **options: Any) -> Service:
        """Create a service as rclpy does; those of parameters refuse unknown types, at which rclpy raises."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = _with_known_types(callback)
        return super().create_service(srv_type, srv_name, callback, **options)

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **options: Any) -> Publisher:
        """Create a publisher as rclpy does, with its QoS overrides. Raises InputError if an override is invalid."""
        return self._overridden(super().create_publisher, 'publisher', topic, (msg_type, topic, qos_profile), options)

    def create_subscription(self, msg_type: Any, topic: str, callback: Any, qos_profile: Any,
                            **options: Any) -> Subscription:
        """Create a subscription as rclpy does, with its QoS overrides. Raises InputError if an override is invalid."""
        return self._overridden(super().create_subscription, 'subscription', topic,
                                (msg_type, topic, callback, qos_profile), options)

    def _overridden(self, create: Any, kind: str, topic: str, arguments: tuple[Any, ...],
                    options: dict[str, Any]) -> Any:
        """Create a publisher or subscription; only overridden policies become parameters."""
        prefix = f'{_QOS}{self.resolve_topic_name(topic)}.{kind}.' if self._given else ''
        policies = [name.removeprefix(prefix) for name in self._given if prefix and name.startswith(prefix)]
        if not policies:
            with shell.in_one_line(f'the {kind} of topic {shown(topic)}'):
                return create(*arguments, **options)
        for policy in policies:
            if policy not in _POLICIES:
                raise InputError(f'parameter {prefix}{policy}: it is not a QoS policy; choose from '
                                 f'{", ".join(_POLICIES)}')
            if kind == 'publisher' and qos.waits(arguments[-1]) and self._given[prefix + policy] != _WAITING.get(
                    policy, self._given[prefix + policy]):
                raise InputError(f'parameter {prefix}{policy}: with time_scale 0, this policy is fixed so that no '
                                 'message is lost; omit it, or set time_scale above 0')
        try:
            return create(*arguments, **options, qos_overriding_options=QoSOverridingOptions(
                [QoSPolicyKind[policy.upper()] for policy in policies]))
        except (RuntimeError, TypeError, ValueError, ParameterException) as error:
            raise InputError(f'parameters {prefix}*: {" ".join(str(error).split())}') from None

    def _check_overrides(self) -> None:
        """Once all topics exist, warn about QoS overrides that match none of them."""
        self._created.cancel()
        for name in self._given:
            if name.startswith(_QOS) and not self.has_parameter(name):
                self.get_logger().warning(
                    f'parameter {name}: {self.get_name()} has no such topic and ignores the parameter; write '
                    f'{_QOS}TOPIC.publisher.POLICY or {_QOS}TOPIC.subscription.POLICY with the full name of the topic')

    def refuse(self, name: str, value: Any) -> None:
        """Raise DragonError, with the reason, if a live parameter must not be set to this value."""

    def changed(self, name: str) -> None:
        """React to the new value of a live parameter."""

    def _widen(self, given: list[RosParameter]) -> list[RosParameter]:
        return [RosParameter(one.name, value=widened(known, one.value)) if (known := self._table.get(one.name)) else one
                for one in given]

    def _on_set(self, given: list[RosParameter]) -> SetParametersResult:
        try:
            for one in given:
                if not one.name:        # rclpy treats an empty name as a known parameter
                    raise InputError('the name of a parameter is empty; give a name')
                if one.name in self._table:
                    check(self._table[one.name], one.value)
                    self.refuse(one.name, one.value)
        except DragonError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_set(self, given: list[RosParameter]) -> None:
        for one in given:
            if one.name in self._table:
                self.setting[one.name] = one.value
                self.changed(one.name)

    def _check_clock(self) -> None:
        """Warn once if ROS time should come from /clock but nothing has arrived."""
        self._patience.cancel()
        if self._ros_time.ros_time_is_active and not self._ros_time.now().nanoseconds:
            self.get_logger().warning(f'use_sim_time is true, but nothing arrived on /clock for {_NO_CLOCK_S:g} s, so '
                                      'stamps from the ROS clock stay 0; start one sim or replay with '
                                      'publish_clock:=true, or set use_sim_time to false')
