//! Ingest of documents built in memory, by subject.

mod build;
mod containers;
mod extras;
mod geometry;
mod glass;
mod graph;
mod hostile;
mod materials;
mod mips;
mod soups;
