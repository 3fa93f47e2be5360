//! Ingest of documents built in memory, by subject.

mod build;
mod containers;
mod environment;
mod geometry;
mod graph;
mod hostile;
mod ies;
mod lights;
mod materials;
mod soups;
