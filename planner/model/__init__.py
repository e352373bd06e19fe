"""What the task means: who holds what where, what is seen, from which view."""
