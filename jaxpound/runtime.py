"""How JAX runs what jaxpound computes: on which cores, in chunks, by programs that are kept."""

from jaxpound._xla.batches import in_chunks, use_cores
from jaxpound._xla.programs import keep_programs, use_loop_kernels

__all__ = ["in_chunks", "keep_programs", "use_cores", "use_loop_kernels"]
