"""Names that the command line offers, without loading what they stand for."""

TIERS = ("null", "null_unit", "null_profile", "null_lossy", "null_noisy", "single", "pair", "triple", "outside", "known_and_unknown", "unidentifiable")
NULLS = TIERS[:5]
PROTOCOLS = ("full", "operating", "table", "thermal")
DETECTABLE = 5.0  # SNR beyond tolerances from which on an effect can be known at all
CLEAR = 10.0  # SNR from which on it is to be found
