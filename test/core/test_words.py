import pytest

from dragon_ros.core.words import counted


@pytest.mark.parametrize(('given', 'text'), [
    ((0, 'tick'), '0 ticks'), ((1, 'tick'), '1 tick'), ((2, 'tick'), '2 ticks'), ((1, 'message', 'was'),
    '1 message was'), ((2, 'message', 'was'), '2 messages were'), ((1, 'tick', 'is'), '1 tick is'),
    ((0, 'tick', 'is'), '0 ticks are'), ((1, 'row', 'has'), '1 row has'), ((3, 'row', 'has'), '3 rows have'),
    ((2, 'bench'), '2 benches'), ((1, '', 'is'), '1 is'), ((2, '', 'is'), '2 are')])
def test_a_count_agrees_with_its_noun_and_its_verb(given, text):
    assert counted(*given) == text


def test_large_counts_can_be_grouped():
    assert (counted(1234567, 'row', form=','), counted(1, 'row', form=',')) == ('1,234,567 rows', '1 row')
