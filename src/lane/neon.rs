//! SIMD lanes of aarch64, where NEON is part of the base instruction set.
#![allow(unused_unsafe, reason = "so its intrinsics are safe to call")]

use std::arch::aarch64::*;

use super::elementary::{INVERSE_SQRT, INVERSE_SQRT_SINGLE};
use super::number::{Lane, Routine, operators};
use super::simd::{inlined, intrinsic, methods, simd_lane};

simd_lane! {
    /// Two instances in double precision (NEON).
    F64x2, f64x2, "neon", f64, float64x2_t, uint64x2_t, 2,
    vdupq_n_f64, vld1q_f64, vst1q_f64, vaddq_f64, vsubq_f64, vmulq_f64, vdivq_f64,
    |x, a, b| vfmaq_f64(b, x, a), vsqrtq_f64,
    |x, y| vbslq_f64(vcltq_f64(x, y), x, y), |x, y| vbslq_f64(vcltq_f64(y, x), x, y),
    vabsq_f64, vrndnq_f64, vcltq_f64, vbslq_f64,
    |a, b| vandq_u64(a, b),
    |mask| (vgetq_lane_u64::<0>(mask) & 1 | vgetq_lane_u64::<1>(mask) & 2) as u32,
    split_f64x2, estimate_f64x2,
    |from| vcvt_f64_f32(vld1_f32(from)),
    |to, x| vst1_f32(to, vcvt_f32_f64(x)),
    vst1q_f64
}

simd_lane! {
    /// Four instances in single precision (NEON).
    F32x4, f32x4, "neon", f32, float32x4_t, uint32x4_t, 4,
    vdupq_n_f32, vld1q_f32, vst1q_f32, vaddq_f32, vsubq_f32, vmulq_f32, vdivq_f32,
    |x, a, b| vfmaq_f32(b, x, a), vsqrtq_f32,
    |x, y| vbslq_f32(vcltq_f32(x, y), x, y), |x, y| vbslq_f32(vcltq_f32(y, x), x, y),
    vabsq_f32, vrndnq_f32, vcltq_f32, vbslq_f32,
    |a, b| vandq_u32(a, b),
    |mask| vaddvq_u32(vandq_u32(mask, vld1q_u32([1, 2, 4, 8].as_ptr()))),
    split_f32x4, estimate_f32x4,
    vld1q_f32,
    vst1q_f32,
    widen_f32x4
}

inlined! {
    // Mantissas and exponents of positive normal numbers, from their bits.
    split_f64x2(x: float64x2_t) -> (float64x2_t, float64x2_t) = {
        let bits = vreinterpretq_u64_f64(x);
        let one = vreinterpretq_u64_f64(vdupq_n_f64(1.0));
        let mantissa = vorrq_u64(vandq_u64(bits, vdupq_n_u64((1 << 52) - 1)), one);
        let exponent = vandq_u64(vshrq_n_u64::<52>(bits), vdupq_n_u64(0x7ff));
        (vreinterpretq_f64_u64(mantissa), vsubq_f64(vcvtq_f64_u64(exponent), vdupq_n_f64(1023.0)))
    };
    split_f32x4(x: float32x4_t) -> (float32x4_t, float32x4_t) = {
        let bits = vreinterpretq_u32_f32(x);
        let one = vreinterpretq_u32_f32(vdupq_n_f32(1.0));
        let mantissa = vorrq_u32(vandq_u32(bits, vdupq_n_u32((1 << 23) - 1)), one);
        let exponent = vandq_u32(vshrq_n_u32::<23>(bits), vdupq_n_u32(0xff));
        (vreinterpretq_f32_u32(mantissa), vsubq_f32(vcvtq_f32_u32(exponent), vdupq_n_f32(127.0)))
    };

    // Estimates of inverse square roots: half the exponent, negated.
    estimate_f64x2(x: float64x2_t) -> float64x2_t = {
        let half = vshrq_n_u64::<1>(vreinterpretq_u64_f64(x));
        vreinterpretq_f64_u64(vsubq_u64(vdupq_n_u64(INVERSE_SQRT), half))
    };
    estimate_f32x4(x: float32x4_t) -> float32x4_t = {
        let half = vshrq_n_u32::<1>(vreinterpretq_u32_f32(x));
        vreinterpretq_f32_u32(vsubq_u32(vdupq_n_u32(INVERSE_SQRT_SINGLE), half))
    };

    // Stores as f64.
    widen_f32x4(to: *mut f64, x: float32x4_t) -> () = {
        vst1q_f64(to, vcvt_f64_f32(vget_low_f32(x)));
        vst1q_f64(to.add(2), vcvt_high_f64_f32(x));
    };
}
