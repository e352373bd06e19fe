"""Pictures that are none of the compiler's: what measuring makes of them."""
