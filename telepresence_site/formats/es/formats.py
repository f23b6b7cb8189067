"""Times are unambiguous in every country, and name their zone."""

DATETIME_FORMAT = "Y-m-d H:i T"
