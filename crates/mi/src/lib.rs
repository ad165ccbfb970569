//! Mutual information and related metrics over joint densities, with exact derivatives.
