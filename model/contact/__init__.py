"""Contact between sheets: how the clamps press, the pressure field, tangential and normal stiffness."""
