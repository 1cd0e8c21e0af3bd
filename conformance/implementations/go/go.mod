module automcm/station

go 1.23
