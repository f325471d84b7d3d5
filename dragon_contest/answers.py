"""The right answers to the contest problem as values for programs, each with its uncertainty, its proof and a command.

``docs/answers.json`` contains them; ``docs/answers.schema.json`` describes their form.
"""
from typing import Any

import dragon_ros as dr
from dragon_contest.mistakes import turning, winding

FORMAT = 1
_LIMIT_M_S = 2.0        # question 5: no handle may be faster
_HANDLES = (0, 1, 51, 101, 151, 201, 223)       # the handles of the tables that the contest asks for
_STATE = 2e-12          # largest error (m or m/s) of a state, tested against 50-digit references
_SPEED = 1e-11


def right_answers() -> dict[str, Any]:
    """Return the answers to questions 1 to 5."""
    touched = dr.compile(winding()).contact()
    assert isinstance(touched, dr.Contact)
    pitch = dr.design.min_pitch()
    turn = turning()
    assert isinstance(turn.track, dr.STurn)
    speed_m_s, below_m_s = dr.design.max_speed(turn).leader_m_s(_LIMIT_M_S)
    entry_s = turn.track.before_m / turn.steady_m_s
    return {
        '$schema': 'answers.schema.json', 'format': FORMAT, 'problem': 'CUMCM 2024 A',
        'made_by': 'dragon_ros: ./dragon grade --right-answers',
        'answers': {
            't_s': _answer(
                2, 's', round(touched.t_s, 12), 1e-9, 'proved', 'no two benches touch until one nanometre of travel '
                'before this time, and two benches overlap one nanometre after it',
                './dragon contact --certificate proof.json'),
            'pitch_m': _answer(
                3, 'm', round(pitch.high_m, 14), round(pitch.high_m - pitch.low_m + _STATE, 13), 'proved', 'at the '
                'lower end of the bracket two benches touch, and from the upper end to 1 m none do; up to the error of '
                'the computed positions', './dragon design min-pitch'),
            'turn_m': _answer(
                4, 'm', round(turn.track.length_m, 12), 1e-12, 'closed form', 'no other ratio of the radii shortens '
                'the turn', './dragon design turn'),
            'speed_m_s': _answer(
                5, 'm/s', round(speed_m_s, 12), round(below_m_s, 13), 'bounded', 'between two computed states, the '
                'slopes of all speeds are bounded, without outward rounding',
                './dragon design max-speed --scene turning')},
        'states': {
            'result1': _states(winding(), [float(t_s) for t_s in range(0, 301, 60)], 0.0,
                               './dragon table --times 0,60,120,180,240,300 --handles 0,1,51,101,151,201,223'),
            'result2': _states(winding(), [touched.t_s], 0.0,
                               f'./dragon table --times {touched.t_s:.12f} --handles 0,1,51,101,151,201,223'),
            'result4': _states(turn, [float(t_s) for t_s in range(-100, 101, 50)], entry_s,
                               './dragon table --scene turning --times 0,50,100,150,200 '
                               '--handles 0,1,51,101,151,201,223')}}


def _answer(question: int, unit: str, value: float, uncertainty: float, status: str, statement: str, command: str,
            ) -> dict[str, Any]:
    return {'question': question, 'value': value, 'unit': unit, 'uncertainty': uncertainty, 'status': status,
            'statement': statement, 'command': command}


def _states(scene: dr.Scene, times_s: list[float], offset_s: float, command: str) -> dict[str, Any]:
    """Return the states of some handles at times counted from ``offset_s``."""
    motion = dr.compile(scene).states([t_s + offset_s for t_s in times_s])
    rows = [{'t_s': round(t_s, 10), 'handle': handle, 'x_m': round(float(p[handle, 0]), 10) + 0.0,
             'y_m': round(float(p[handle, 1]), 10) + 0.0, 'speed_m_s': round(float(speed[handle]), 10)}
            for t_s, p, speed in zip(times_s, motion.handles_m, motion.speed_m_s, strict=True) for handle in _HANDLES]
    return {'uncertainty_m': _STATE + 5e-11, 'uncertainty_m_s': _SPEED + 5e-11, 'status': 'tested', 'statement':
            'tested against 50-digit references', 'command': command, 'rows': rows}
