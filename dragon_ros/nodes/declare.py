"""Parameters on a node: declared from a table, checked when they are set, with a reason where they are refused."""
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from dragon_ros.core.errors import InputError
from dragon_ros.nodes.params import Parameter


def declare(node: Node, parameter: Parameter) -> Any:
    """Declare a parameter and return its value. Raises InputError that names it, the value and the limits."""
    given = node._parameter_overrides.get(parameter.name)
    if given is not None:
        node._parameter_overrides[parameter.name] = widened(parameter, given)
    try:
        value = node.declare_parameter(parameter.name, parameter.default, descriptor_of(parameter)).value
    except InvalidParameterTypeException:
        wanted = type(parameter.default).__name__
        raise InputError(f'parameter {parameter.name}: is not of type {wanted}; {parameter.text}') from None
    except InvalidParameterValueException:
        raise InputError(f'parameter {parameter.name}: is outside {parameter.low} to {parameter.high}; '
                         f'{parameter.text}') from None
    check(parameter, value)
    return value


def check(parameter: Parameter, value: Any) -> None:
    """Raise InputError where the value is not one of the choices; ROS checks types and ranges."""
    if parameter.choices and value not in parameter.choices:
        raise InputError(f'parameter {parameter.name}: {value!r} is not one of {", ".join(parameter.choices)}; '
                         f'{parameter.text}')


def widened(parameter: Parameter, given: RosParameter) -> RosParameter:
    """Take a whole number for a float parameter: ``-p rate_hz:=50`` means 50.0."""
    whole = isinstance(parameter.default, float) and type(given.value) is int
    return RosParameter(given.name, value=float(given.value)) if whole else given


def descriptor_of(parameter: Parameter) -> ParameterDescriptor:
    """Return what ``ros2 param describe`` shows."""
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
