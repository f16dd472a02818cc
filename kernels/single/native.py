"""Helpers for C++ snippets for the CPU, written with vectors that LLVM maps to the CPU's registers."""


def on_cpu(snippet: str) -> str:
    """Wrap a C++ snippet for `wp.func_native`; on CUDA, where it may be compiled but is never called, it returns 0."""
    return f"""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    // products are fused with sums, where the CPU can
    #pragma clang fp contract(fast)
    typedef float floats __attribute__((ext_vector_type(8)));
    typedef int ints __attribute__((ext_vector_type(8)));
    typedef bool bools __attribute__((ext_vector_type(8)));
    typedef float floats_anywhere __attribute__((ext_vector_type(8), aligned(4)));
    typedef int ints_anywhere __attribute__((ext_vector_type(8), aligned(4)));
    // NaN is lost as the first of two
    const auto larger = [](auto a, auto b) {{ return a > b ? a : b; }};
    const auto smaller = [](auto a, auto b) {{ return a < b ? a : b; }};
    const auto bits_of = [](ints is_set) -> int {{
        const bools set = __builtin_convertvector(is_set, bools);
        unsigned char bits;
        __builtin_memcpy(&bits, &set, sizeof(bits));
        return bits;
    }};
    {snippet}
#endif
"""
