"""A study whose rows take a few hundredths of a second, so that tests can interfere halfway.

Half of the rows are rejected because the chain is locked from the start.
"""
SLOWER = """
set: {dragon: {benches: 24}, run: {start_s: 405, stop_s: 411}}
vary:
  dragon.width_m: {uniform: [0.1, 0.4]}
  track.start_turns: [1, 16]
design: random
samples: 48
ask: [contact, lock]
"""
# Rows that take a millisecond.
QUICK = """
set: {dragon: {benches: 3}}
vary:
  dragon.width_m: {uniform: [0.2, 0.4]}
  track.pitch_m: {from: 0.5, to: 0.6}
design: random
samples: 12
ask: [lock]
"""
