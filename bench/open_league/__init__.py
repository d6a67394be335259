"""The open league: campaigns from any hand, their truth sealed by a hash until all have answered.

`draw` makes games, `sealed` locks and opens the truth, `play` runs entries, `score` counts; the
interface, truth.json included, is docs/open-league.md.
"""
