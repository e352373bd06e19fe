"""The compiler: task, workcell and drawings in, an augmented plan out."""
