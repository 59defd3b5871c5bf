//! Units and plausible intervals of the quantities in files, so that a wrong unit is caught and named.

/// The unit a key's name ends in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unit {
    Metre,
    Second,
    Degree,
    DegreePerSecond,
    DegreePerSecondSquared,
    Microsecond,
    Pixel,
    MetrePerSecond,
    /// A share or a ratio.
    Ratio,
    /// A count, a size in GB, a coefficient.
    Plain,
}

impl Unit {
    fn symbol(self) -> &'static str {
        match self {
            Self::Metre => " m",
            Self::Second => " s",
            Self::Degree => " degrees",
            Self::DegreePerSecond => " degrees/s",
            Self::DegreePerSecondSquared => " degrees/s^2",
            Self::Microsecond => " microseconds",
            Self::Pixel => " px",
            Self::MetrePerSecond => " m/s",
            Self::Ratio | Self::Plain => "",
        }
    }

    /// Units that are mistaken for this one, and the factor that turns them into it.
    fn confusions(self) -> &'static [(f64, &'static str)] {
        match self {
            Self::Metre => &[(1e-3, "millimetres"), (1e-2, "centimetres"), (1e3, "kilometres")],
            Self::Second => &[(1e-3, "milliseconds"), (1e-6, "microseconds"), (60.0, "minutes")],
            Self::Degree | Self::DegreePerSecond | Self::DegreePerSecondSquared => {
                &[(180.0 / core::f64::consts::PI, "radians")]
            }
            Self::Microsecond => &[(1e3, "milliseconds"), (1e6, "seconds")],
            Self::MetrePerSecond => &[(1.0 / 3.6, "km/h"), (1e-2, "cm/s"), (1e-3, "mm/s")],
            Self::Ratio => &[(1e-2, "per cent")],
            Self::Pixel | Self::Plain => &[],
        }
    }
}

/// A unit and the interval of values that make sense, ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Quantity {
    unit: Unit,
    low: f64,
    high: f64,
}

impl Quantity {
    pub(super) const fn new(unit: Unit, low: f64, high: f64) -> Self {
        Self { unit, low, high }
    }

    pub(super) fn admits(&self, value: f64) -> bool {
        value >= self.low && value <= self.high
    }

    /// What was expected instead of `value`, with a guess at the unit it was meant in.
    pub(super) fn expectation(&self, value: f64) -> String {
        let symbol = self.unit.symbol();
        let interval = format!("{} to {}{symbol}", self.low, self.high);
        let guess = self.unit.confusions().iter().find(|(factor, _)| value != 0.0 && self.admits(value * factor));
        match guess {
            Some((factor, name)) => {
                let meant = (value * factor * 1e6).round() / 1e6;
                format!("{interval}; did you mean {name}? then write {meant}")
            }
            None => interval,
        }
    }

    pub(super) fn describe(&self) -> String {
        format!("a number from {} to {}{}", self.low, self.high, self.unit.symbol())
    }
}
