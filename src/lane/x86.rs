//! SIMD lanes of x86-64: AVX-512 and AVX2 with FMA.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::simd::simd_lane;
use super::{Lane, assigning_ops};

const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

simd_lane! {
    /// Eight instances in double precision (AVX-512F).
    F64x8, f64, __m512d, __mmask8, 8,
    _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd,
    _mm512_fmadd_pd, _mm512_sqrt_pd, _mm512_min_pd, _mm512_max_pd, _mm512_abs_pd,
    _mm512_roundscale_pd::<NEAREST>, _mm512_cmp_pd_mask::<_CMP_LT_OQ>,
    |mask, yes, no| _mm512_mask_blend_pd(mask, no, yes),
    |mask| mask != 0
}

simd_lane! {
    /// Sixteen instances in single precision (AVX-512F).
    F32x16, f32, __m512, __mmask16, 16,
    _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps,
    _mm512_fmadd_ps, _mm512_sqrt_ps, _mm512_min_ps, _mm512_max_ps, _mm512_abs_ps,
    _mm512_roundscale_ps::<NEAREST>, _mm512_cmp_ps_mask::<_CMP_LT_OQ>,
    |mask, yes, no| _mm512_mask_blend_ps(mask, no, yes),
    |mask| mask != 0
}

simd_lane! {
    /// Four instances in double precision (AVX2 and FMA).
    F64x4, f64, __m256d, __m256d, 4,
    _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd,
    _mm256_fmadd_pd, _mm256_sqrt_pd, _mm256_min_pd, _mm256_max_pd,
    |x| _mm256_andnot_pd(_mm256_set1_pd(-0.0), x),
    _mm256_round_pd::<NEAREST>, _mm256_cmp_pd::<_CMP_LT_OQ>,
    |mask, yes, no| _mm256_blendv_pd(no, yes, mask),
    |mask| unsafe { _mm256_movemask_pd(mask) } != 0
}

simd_lane! {
    /// Eight instances in single precision (AVX2 and FMA).
    F32x8, f32, __m256, __m256, 8,
    _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps,
    _mm256_fmadd_ps, _mm256_sqrt_ps, _mm256_min_ps, _mm256_max_ps,
    |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x),
    _mm256_round_ps::<NEAREST>, _mm256_cmp_ps::<_CMP_LT_OQ>,
    |mask, yes, no| _mm256_blendv_ps(no, yes, mask),
    |mask| unsafe { _mm256_movemask_ps(mask) } != 0
}
