//! Tests of the written files as one program, because linking takes most of the time.

mod occluders;
