//! Tests of the files that are written, in one program: linking is what costs.

mod occluders;
