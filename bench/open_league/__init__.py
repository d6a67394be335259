"""Open league: campaigns by anyone, whose truth is sealed by a hash until all have answered.

`draw` makes games, `sealed` seals and opens the truth, `play` runs entries, `score` counts; the
interface, including truth.json, is described in docs/open-league.md.
"""
