"""As `python -m k1607_pin.cli`."""

from k1607_pin.cli import main

main()
