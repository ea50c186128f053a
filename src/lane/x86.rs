//! SIMD lanes of x86-64: AVX-512 and AVX2 with FMA.

use std::arch::x86_64::*;

use super::elementary::{INVERSE_SQRT, INVERSE_SQRT_SINGLE};
use super::number::{Lane, Routine, operators};
use super::simd::{inlined, intrinsic, methods, simd_lane};

const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

/// Bit fields of a number.
const FRACTION: i64 = (1 << 52) - 1;
const EXPONENT: i64 = 0x7ff;
const FRACTION_SINGLE: i32 = (1 << 23) - 1;
const EXPONENT_SINGLE: i32 = 0xff;
/// Offset at which the spacing of numbers is 1: the last bits of its sum with a small integer are that integer.
const ULP_ONE: f64 = 4_503_599_627_370_496.0;

simd_lane! {
    /// Eight instances in double precision (AVX-512F).
    F64x8, f64x8, "avx512f,avx2,fma", f64, __m512d, __mmask8, 8,
    _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd,
    _mm512_fmadd_pd, _mm512_sqrt_pd, _mm512_min_pd, _mm512_max_pd, _mm512_abs_pd,
    _mm512_roundscale_pd::<NEAREST>, _mm512_cmp_pd_mask::<_CMP_LT_OQ>,
    select_f64x8, and_mask8, bits_mask8,
    split_f64x8, estimate_f64x8,
    load_single_f64x8, store_single_f64x8,
    _mm512_storeu_pd
}

simd_lane! {
    /// Sixteen instances in single precision (AVX-512F).
    F32x16, f32x16, "avx512f,avx2,fma", f32, __m512, __mmask16, 16,
    _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps,
    _mm512_fmadd_ps, _mm512_sqrt_ps, _mm512_min_ps, _mm512_max_ps, _mm512_abs_ps,
    _mm512_roundscale_ps::<NEAREST>, _mm512_cmp_ps_mask::<_CMP_LT_OQ>,
    select_f32x16, and_mask16, bits_mask16,
    split_f32x16, estimate_f32x16,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    widen_f32x16
}

simd_lane! {
    /// Four instances in double precision (AVX2 and FMA).
    F64x4, f64x4, "avx2,fma", f64, __m256d, __m256d, 4,
    _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd,
    _mm256_fmadd_pd, _mm256_sqrt_pd, _mm256_min_pd, _mm256_max_pd,
    abs_f64x4,
    _mm256_round_pd::<NEAREST>, _mm256_cmp_pd::<_CMP_LT_OQ>,
    select_f64x4, _mm256_and_pd, bits_f64x4,
    split_f64x4, estimate_f64x4,
    load_single_f64x4, store_single_f64x4,
    _mm256_storeu_pd
}

simd_lane! {
    /// Eight instances in single precision (AVX2 and FMA).
    F32x8, f32x8, "avx2,fma", f32, __m256, __m256, 8,
    _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps,
    _mm256_fmadd_ps, _mm256_sqrt_ps, _mm256_min_ps, _mm256_max_ps,
    abs_f32x8,
    _mm256_round_ps::<NEAREST>, _mm256_cmp_ps::<_CMP_LT_OQ>,
    select_f32x8, _mm256_and_ps, bits_f32x8,
    split_f32x8, estimate_f32x8,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    widen_f32x8
}

inlined! {
    select_f64x8(mask: __mmask8, yes: __m512d, no: __m512d) -> __m512d = _mm512_mask_blend_pd(mask, no, yes);
    and_mask8(a: __mmask8, b: __mmask8) -> __mmask8 = a & b;
    bits_mask8(mask: __mmask8) -> u32 = u32::from(mask);
    load_single_f64x8(from: *const f32) -> __m512d = _mm512_cvtps_pd(_mm256_loadu_ps(from));
    store_single_f64x8(to: *mut f32, x: __m512d) -> () = _mm256_storeu_ps(to, _mm512_cvtpd_ps(x));

    select_f32x16(mask: __mmask16, yes: __m512, no: __m512) -> __m512 = _mm512_mask_blend_ps(mask, no, yes);
    and_mask16(a: __mmask16, b: __mmask16) -> __mmask16 = a & b;
    bits_mask16(mask: __mmask16) -> u32 = u32::from(mask);

    abs_f64x4(x: __m256d) -> __m256d = _mm256_andnot_pd(_mm256_set1_pd(-0.0), x);
    select_f64x4(mask: __m256d, yes: __m256d, no: __m256d) -> __m256d = _mm256_blendv_pd(no, yes, mask);
    bits_f64x4(mask: __m256d) -> u32 = _mm256_movemask_pd(mask) as u32;
    load_single_f64x4(from: *const f32) -> __m256d = _mm256_cvtps_pd(_mm_loadu_ps(from));
    store_single_f64x4(to: *mut f32, x: __m256d) -> () = _mm_storeu_ps(to, _mm256_cvtpd_ps(x));

    abs_f32x8(x: __m256) -> __m256 = _mm256_andnot_ps(_mm256_set1_ps(-0.0), x);
    select_f32x8(mask: __m256, yes: __m256, no: __m256) -> __m256 = _mm256_blendv_ps(no, yes, mask);
    bits_f32x8(mask: __m256) -> u32 = _mm256_movemask_ps(mask) as u32;

    // Mantissas and exponents of positive normal numbers, from their bits.
    split_f64x8(x: __m512d) -> (__m512d, __m512d) = {
        let bits = _mm512_castpd_si512(x);
        let fraction = _mm512_and_si512(bits, _mm512_set1_epi64(FRACTION));
        let mantissa = _mm512_or_si512(fraction, _mm512_castpd_si512(_mm512_set1_pd(1.0)));
        let exponent = _mm512_and_si512(_mm512_srli_epi64::<52>(bits), _mm512_set1_epi64(EXPONENT));
        let shifted = _mm512_or_si512(exponent, _mm512_castpd_si512(_mm512_set1_pd(ULP_ONE)));
        (_mm512_castsi512_pd(mantissa), _mm512_sub_pd(_mm512_castsi512_pd(shifted), _mm512_set1_pd(ULP_ONE + 1023.0)))
    };
    split_f32x16(x: __m512) -> (__m512, __m512) = {
        let bits = _mm512_castps_si512(x);
        let fraction = _mm512_and_si512(bits, _mm512_set1_epi32(FRACTION_SINGLE));
        let mantissa = _mm512_or_si512(fraction, _mm512_castps_si512(_mm512_set1_ps(1.0)));
        let exponent = _mm512_and_si512(_mm512_srli_epi32::<23>(bits), _mm512_set1_epi32(EXPONENT_SINGLE));
        let exponent = _mm512_cvtepi32_ps(exponent);
        (_mm512_castsi512_ps(mantissa), _mm512_sub_ps(exponent, _mm512_set1_ps(127.0)))
    };
    split_f64x4(x: __m256d) -> (__m256d, __m256d) = {
        let bits = _mm256_castpd_si256(x);
        let fraction = _mm256_and_si256(bits, _mm256_set1_epi64x(FRACTION));
        let mantissa = _mm256_or_si256(fraction, _mm256_castpd_si256(_mm256_set1_pd(1.0)));
        let exponent = _mm256_and_si256(_mm256_srli_epi64::<52>(bits), _mm256_set1_epi64x(EXPONENT));
        let shifted = _mm256_or_si256(exponent, _mm256_castpd_si256(_mm256_set1_pd(ULP_ONE)));
        (_mm256_castsi256_pd(mantissa), _mm256_sub_pd(_mm256_castsi256_pd(shifted), _mm256_set1_pd(ULP_ONE + 1023.0)))
    };
    split_f32x8(x: __m256) -> (__m256, __m256) = {
        let bits = _mm256_castps_si256(x);
        let fraction = _mm256_and_si256(bits, _mm256_set1_epi32(FRACTION_SINGLE));
        let mantissa = _mm256_or_si256(fraction, _mm256_castps_si256(_mm256_set1_ps(1.0)));
        let exponent = _mm256_and_si256(_mm256_srli_epi32::<23>(bits), _mm256_set1_epi32(EXPONENT_SINGLE));
        (_mm256_castsi256_ps(mantissa), _mm256_sub_ps(_mm256_cvtepi32_ps(exponent), _mm256_set1_ps(127.0)))
    };

    // Estimates of inverse square roots: half the exponent, negated.
    estimate_f64x8(x: __m512d) -> __m512d = {
        let half = _mm512_srli_epi64::<1>(_mm512_castpd_si512(x));
        _mm512_castsi512_pd(_mm512_sub_epi64(_mm512_set1_epi64(INVERSE_SQRT as i64), half))
    };
    estimate_f32x16(x: __m512) -> __m512 = {
        let half = _mm512_srli_epi32::<1>(_mm512_castps_si512(x));
        _mm512_castsi512_ps(_mm512_sub_epi32(_mm512_set1_epi32(INVERSE_SQRT_SINGLE as i32), half))
    };
    estimate_f64x4(x: __m256d) -> __m256d = {
        let half = _mm256_srli_epi64::<1>(_mm256_castpd_si256(x));
        _mm256_castsi256_pd(_mm256_sub_epi64(_mm256_set1_epi64x(INVERSE_SQRT as i64), half))
    };
    estimate_f32x8(x: __m256) -> __m256 = {
        let half = _mm256_srli_epi32::<1>(_mm256_castps_si256(x));
        _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_set1_epi32(INVERSE_SQRT_SINGLE as i32), half))
    };

    // Stores as f64.
    widen_f32x16(to: *mut f64, x: __m512) -> () = {
        let high = _mm512_extractf64x4_pd::<1>(_mm512_castps_pd(x));
        _mm512_storeu_pd(to, _mm512_cvtps_pd(_mm512_castps512_ps256(x)));
        _mm512_storeu_pd(to.add(8), _mm512_cvtps_pd(_mm256_castpd_ps(high)));
    };
    widen_f32x8(to: *mut f64, x: __m256) -> () = {
        _mm256_storeu_pd(to, _mm256_cvtps_pd(_mm256_castps256_ps128(x)));
        _mm256_storeu_pd(to.add(4), _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(x)));
    };
}
