"""The answer of a static or explicit solver: functions of its state, subject by subject."""
