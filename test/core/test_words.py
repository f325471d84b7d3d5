import pytest

from dragon_ros.core.words import counted, length


@pytest.mark.parametrize(('given', 'text'), [
    ((0, 'tick'), '0 ticks'), ((1, 'tick'), '1 tick'), ((2, 'tick'), '2 ticks'), ((1, 'message', 'was'),
    '1 message was'), ((2, 'message', 'was'), '2 messages were'), ((1, 'tick', 'is'), '1 tick is'),
    ((0, 'tick', 'is'), '0 ticks are'), ((1, 'row', 'has'), '1 row has'), ((3, 'row', 'has'), '3 rows have'),
    ((2, 'bench'), '2 benches'), ((1, '', 'is'), '1 is'), ((2, '', 'is'), '2 are')])
def test_a_count_agrees_with_its_noun_and_its_verb(given, text):
    assert counted(*given) == text


def test_large_counts_can_be_grouped():
    assert (counted(1234567, 'row', form=','), counted(1, 'row', form=',')) == ('1,234,567 rows', '1 row')


@pytest.mark.parametrize(('metres', 'text'), [
    (0.0, '0 mm'), (4e-14, '0 mm'), (1e-5, '0.1 mm'), (0.00419, '4.2 mm'), (0.02, '20 mm'), (0.0203, '21 mm'),
    (0.05, '50 mm'), (1.0, '1.00 m'), (0.9995, '1.00 m'), (13.941, '13.95 m'), (13.0, '13.00 m')])
def test_a_length_has_the_digits_of_a_tape_measure_and_is_not_too_small(metres, text):
    assert length(metres) == text
