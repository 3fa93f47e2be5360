//! Tests of ingest as one program, because linking each file separately takes most of the time.

mod corpus;
mod ingest;
