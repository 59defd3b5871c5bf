//! Real roots of a polynomial in one unknown.

/// Newton steps and bisections per root; bisection alone gains a bit each.
const MAX_STEPS: usize = 200;

/// Value at `x` of the polynomial with the given coefficients, highest power first.
fn value(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Returns the real roots in ascending order; coefficients from the highest power down.
///
/// # Method
/// Between two neighbouring roots of the derivative the polynomial is monotone, so each such interval, and the two
/// beyond the outermost, holds at most one root. The derivative's roots come from its own derivative, and so on down to
/// a straight line. A double root that rounding lifts off the axis is missed, as it is by any bracketing method.
pub(super) fn real_roots(coefficients: &[f64]) -> Vec<f64> {
    let significant = coefficients.iter().position(|c| *c != 0.0).unwrap_or(coefficients.len());
    let coefficients = &coefficients[significant..];
    let degree = coefficients.len().saturating_sub(1);
    if degree == 0 {
        return Vec::new();
    }
    if degree == 1 {
        return vec![-coefficients[1] / coefficients[0]];
    }
    let slope: Vec<f64> = coefficients[..degree].iter().enumerate().map(|(i, c)| c * (degree - i) as f64).collect();
    // Cauchy's bound holds for the roots of the polynomial; its derivative's lie in their hull (Gauss-Lucas).
    let bound = 1.0 + coefficients[1..].iter().map(|c| (c / coefficients[0]).abs()).fold(0.0, f64::max);
    let mut ends = vec![-bound];
    ends.extend(real_roots(&slope).into_iter().filter(|x| x.abs() < bound));
    ends.push(bound);
    ends.windows(2).filter_map(|pair| root_between(coefficients, &slope, pair[0], pair[1])).collect()
}

/// The root of a monotone piece, if the signs at its ends differ. Newton's method, with bisection where that leaves the
/// bracket or does not halve the step (far from the roots a Newton step gains but a tenth of the way).
fn root_between(coefficients: &[f64], slope: &[f64], low: f64, high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(coefficients, low), value(coefficients, high));
    if at_low == 0.0 {
        return Some(low);
    }
    if !(at_low * at_high < 0.0) {
        return None;
    }
    let (mut negative, mut positive) = if at_low < 0.0 { (low, high) } else { (high, low) };
    let mut x = f64::midpoint(low, high);
    let mut last_step = high - low;
    for _ in 0..MAX_STEPS {
        let at_x = value(coefficients, x);
        if at_x < 0.0 {
            negative = x;
        } else {
            positive = x;
        }
        let newton = x - at_x / value(slope, x);
        let inside = (newton - negative) * (newton - positive) < 0.0;
        let halves = (newton - x).abs() < 0.5 * last_step.abs();
        let next = if inside && halves { newton } else { f64::midpoint(negative, positive) };
        last_step = next - x;
        if last_step.abs() <= 4.0 * f64::EPSILON * x.abs() {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_roots_of_a_product_of_ten_factors_are_found() {
        let roots = [-3.1, -1.2, -0.4, 0.0, 0.3, 0.9, 1.7, 2.5, 6.0, 40.0];
        let mut coefficients = vec![2.0];
        for root in roots {
            let mut product = coefficients.clone();
            product.push(0.0);
            for (i, c) in coefficients.iter().enumerate() {
                product[i + 1] -= c * root;
            }
            coefficients = product;
        }
        let found = real_roots(&coefficients);
        assert_eq!(found.len(), 10, "{found:?}");
        for (found, root) in found.iter().zip(roots) {
            assert!((found - root).abs() < 1e-7 * (1.0 + root.abs()), "{found} instead of {root}");
        }
    }

    #[test]
    fn polynomials_without_real_roots_have_none() {
        assert_eq!(real_roots(&[1.0, 0.0, 1.0]), Vec::<f64>::new());
        assert_eq!(real_roots(&[0.0, 0.0, 3.0]), Vec::<f64>::new());
        assert_eq!(real_roots(&[]), Vec::<f64>::new());
        assert_eq!(real_roots(&[f64::NAN, 1.0, 2.0]).len(), 0);
    }
}
