"""Sets of features: the covariance of a part's pose by several measurements.

In: `Feature` from `features`, `ChainScore` from `trials`, `PoseRequirement` from
`planner.looks`. Out: `FeatureSet`, `Criteria` to `planner.looks`.
The type that passes: `FeatureMeasurement` (pose_covariance).
May be touched here: the search's order of exchanges, as long as it is as good as trying
all sets.
Watched by: tests/featuresel/sets/test_feature_set.py
"""
