// Fill memory with zero bytes on all cores of a processor.
//
// Layout: each work-item fills BYTES bytes of out.
// Precondition: BYTES is a multiple of 64.
#ifndef BYTES
#define BYTES 4096
#endif

__kernel void clear(__global float* const out) {
    __global float* const part = out + (size_t)get_global_id(0) * (BYTES / 4);
    for (int k = 0; k < BYTES / 64; ++k) vstore16((float16)(0.0f), k, part);
}
