"""Eleven laws on the same line with 10 lb for the middle third, at 10 ms in full gravity: with a right and a wrong model.

The whole comparison, both paths, 1 ms and weightlessness too, is `k1607 compare`: some minutes.
Run: python examples/compare_laws.py
"""

from k1607_pin.report.comparison import TROUBLES, compare

rows = list(compare(cases=[1], periods=[0.01], gravities=[9.81], troubles=TROUBLES[:2]))
troubles = list(dict.fromkeys(row.trouble for row in rows))
print("RMS distance from the path, mm:", *(f"{name:>14s}" for name in troubles))
for law in dict.fromkeys(row.law for row in rows):
    print(f"{law:31s}", *(f"{1e3 * row.rms:14.3f}" for row in rows if row.law == law))
