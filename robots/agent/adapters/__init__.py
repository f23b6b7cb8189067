"""One file a robot control architecture; contract.py says what each must be."""
