//! Ingest of documents built in memory, by subject.

mod build;
mod containers;
mod environment;
mod extras;
mod geometry;
mod glass;
mod graph;
mod hostile;
mod ies;
mod lights;
mod lods;
mod materials;
mod mips;
mod soups;
