//! The whole system, end to end: see `tests/system`. The programs themselves are run, as a user would run them.
