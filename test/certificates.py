"""Verdicts of ``dragon_ros.verify`` on certificates, as plain values; shared by the tests of several rooms."""
import json

import pytest

from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.scenes.certificate import as_values
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.proof import prove
from dragon_ros.verify.reading import claims_of


def written(scene):
    """The certificate that the solver writes for a scene."""
    return as_values(scene, first_contact(scene))


def proved(values, effort=1.0):
    """The statement that a certificate proves."""
    return prove(claims_of(json.dumps(values).encode()), effort, lambda *told: None).sentence


def refusal(values, effort=1.0):
    """The error message that rejects a certificate."""
    with pytest.raises(Refused) as refused:
        proved(values, effort)
    return str(refused.value)
