"""What travels through the package: FRFs, points and degrees of freedom, the modal model, and its errors."""
