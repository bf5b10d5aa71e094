-- error of the estimator on frames it never saw, from the camera as trained and from one that was turned
SELECT estimator, misalignment_kind, misalignment_deg,
       avg(error) AS mean_error, median(error) AS median_error, quantile_cont(error, 0.95) AS p95_error,
       count(*) AS frames
FROM predictions
WHERE estimator IN ('laptop')
GROUP BY ALL
ORDER BY ALL
