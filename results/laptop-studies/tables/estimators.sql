-- the estimators, and their error on the test episodes of their dataset [m]
SELECT estimator, status, dataset, epochs, parameters, test_mean_error, test_median_error, test_p95_error, config_sha256
FROM estimators
WHERE estimator IN ('laptop')
ORDER BY estimator
