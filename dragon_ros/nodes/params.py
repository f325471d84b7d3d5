"""Parameters of the nodes, each declared once: name, default, limits and text."""
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from dragon_ros.core.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """One parameter; the type is that of the default, numbers have limits, texts may have choices.

    All are read when the node starts.
    """

    name: str
    default: Any
    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()

    @property
    def descriptor(self) -> ParameterDescriptor:
        """What ``ros2 param describe`` shows."""
        out = ParameterDescriptor(name=self.name, description=self.text, read_only=True,
                                  additional_constraints=f'one of {", ".join(self.choices)}' if self.choices else '')
        if self.low is not None and isinstance(self.default, float):
            out.floating_point_range = [FloatingPointRange(from_value=float(self.low), to_value=float(self.high))]
        elif self.low is not None:
            out.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high))]
        return out


def declare(node: Node, parameter: Parameter) -> Any:
    """Declare a parameter and return its value. Raises InputError that names it, the value and the limits."""
    _widen(node, parameter)
    try:
        value = node.declare_parameter(parameter.name, parameter.default, parameter.descriptor).value
    except InvalidParameterTypeException:
        wanted = type(parameter.default).__name__
        raise InputError(f'parameter {parameter.name}: is not of type {wanted}; {parameter.text}') from None
    except InvalidParameterValueException:
        raise InputError(f'parameter {parameter.name}: is outside {parameter.low} to {parameter.high}; '
                         f'{parameter.text}') from None
    if parameter.choices and value not in parameter.choices:
        raise InputError(f'parameter {parameter.name}: {value!r} is not one of {", ".join(parameter.choices)}; '
                         f'{parameter.text}')
    return value


def _widen(node: Node, parameter: Parameter) -> None:
    """Take a whole number for a float parameter: ``-p rate_hz:=50`` means 50.0."""
    given = node._parameter_overrides.get(parameter.name)
    if given is not None and isinstance(parameter.default, float) and type(given.value) is int:
        node._parameter_overrides[parameter.name] = RosParameter(parameter.name, value=float(given.value))
