-- error of the estimator after each epoch
SELECT estimator, split, epoch, mean_error, median_error, p95_error, loss, seconds
FROM epochs
WHERE estimator IN ('laptop')
ORDER BY estimator, split, epoch
