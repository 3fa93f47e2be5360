//! Tests of ingest, in one program: linking is what costs, and each file of its own would be
//! linked with everything below it once more.

mod corpus;
mod ingest;
