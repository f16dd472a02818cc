"""What is written in CUDA's own language, where Warp has no words for what is wanted."""


def on_cuda(snippet: str) -> str:
    """For `wp.func_native`: on the CPU, where it is compiled at most and never called, it gives 0."""
    return f"""
#if defined(__CUDA_ARCH__)
{snippet}
#else
    return 0;
#endif
"""
