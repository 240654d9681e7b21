"""One attitude in every form and frame, and what each common mistake would make of it."""
