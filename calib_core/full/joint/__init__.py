"""The joint estimation: state, factors, association, propagation, schedule."""
