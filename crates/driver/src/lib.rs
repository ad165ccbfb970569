//! Registration of photographs to surfaces by mutual information.
