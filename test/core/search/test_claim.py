"""The claim of a search about a contact: the rate at which the gap closes."""
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import _Claim, first_contact
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Spiral


@pytest.mark.parametrize('scene', [Scene(run=Run(400)), Scene(Dragon(40), Spiral(0.55, 7.0))], ids=['classic', 'small'])
def test_the_gap_closes_at_the_contact_as_its_differences_say(scene):
    found = first_contact(scene)
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    domain = SearchDomain(scene, travel, 1, lambda states: None)
    claim = _Claim(domain, found.benches, domain.gone_m(found.t_s))
    step_m = 1e-4
    early, late = (domain.gap(found.benches, claim.gone_m + sense * step_m) for sense in (-1, 1))
    assert claim.slope == pytest.approx((early - late) / (2 * step_m), rel=1e-3)
    assert claim._steepest == pytest.approx(claim.slope, rel=1e-2)
    assert 0 < claim.slack_m < 1e-6
