"""Bad data found and named: single readings, swapped names, units, signs and conventions.

Each is a discrete mistake with a discrete correction. A mistake is stated only when the data speak
for it and its correction makes them agree; both results are given, corrected and as given.
"""
