//! Scene makers and helpers for Lumel's whole-pipeline tests.
