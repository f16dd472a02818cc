"""Helper for CUDA C++ snippets, for operations that Warp does not offer."""


def on_cuda(snippet: str) -> str:
    """Wrap a snippet for `wp.func_native`; on the CPU, where it may be compiled but is never called, it returns 0."""
    return f"""
#if defined(__CUDA_ARCH__)
{snippet}
#else
    return 0;
#endif
"""
