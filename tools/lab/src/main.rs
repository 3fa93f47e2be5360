//! Runs the method laboratory and writes its tables.

fn main() {}
